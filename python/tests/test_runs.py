"""Cohorts through the programs of the package."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import cardiotwin
import numpy as np
import pandas as pd
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_programs_are_those_of_the_package() -> None:
    assert cardiotwin.program().parent == Path(sys.prefix).resolve() / "bin"
    said = subprocess.run([cardiotwin.program(), "--version"], capture_output=True, text=True, check=True).stdout
    assert said.split()[1] == cardiotwin.__version__


def test_results_are_tables(run: cardiotwin.Run) -> None:
    assert list(run.patients) == ["01-CoA", "03-CoA"]
    assert set(run.table["state"]) == {"done"}
    patient = run.patients["01-CoA"]
    assert patient.biomarkers.loc["P_max_mmHg", ["measured", "step1", "step3"]].between(80, 160).all()
    assert patient.parameters.loc[("step1", "Smax_ref_kPa"), "unit"] == "kPa"
    assert {"step1", "step2", "step3"} <= set(patient.parameters.index.get_level_values("step"))
    twin = patient.posterior
    assert (twin["p5"] <= twin["p95"]).all() and patient.draws.shape == (100, len(twin))
    pressure = patient.traces.query("source == 'step3' and signal == 'pressure'")
    assert pressure["value"].max() == pytest.approx(patient.biomarkers.loc["P_max_mmHg", "step3"], rel=1e-2)
    assert patient.record["plan"]["id"] == "01-CoA"


def test_the_twin_s_beat_is_the_run_s(run: cardiotwin.Run) -> None:
    patient = run.patients["03-CoA"]
    beat = patient.ventricle.beat()
    stored = patient.biomarkers["step3"]
    for name in ("P_max_mmHg", "SV_mL", "dPdt_max_mmHg_per_ms"):
        assert beat.biomarkers[name] == pytest.approx(stored[name], rel=1e-9)


def test_traces_for_polars_and_xarray(run: cardiotwin.Run) -> None:
    patient = run.patients["01-CoA"]
    assert patient.traces_polars.shape == patient.traces.shape
    pressure = patient.traces_xarray["measured"]["pressure"]
    assert pressure.attrs["units"] == "mmHg"
    measured = patient.traces.query("source == 'measured' and signal == 'pressure'")["value"]
    assert np.array_equal(pressure.to_numpy(), measured.to_numpy())


def test_parquet_exports_are_read_by_pandas(run: cardiotwin.Run, elsewhere: Path) -> None:
    files = {file.name: file for file in run.export(elsewhere, "--parquet")}
    traces = pd.read_parquet(files["traces.parquet"])
    csv = pd.read_csv(files["traces.csv"])
    pd.testing.assert_frame_equal(traces, csv, check_dtype=False, rtol=1e-12)
    assert traces["value"].dtype == float and set(traces["patient"]) == {"01-CoA", "03-CoA"}
    for name in ("table_1", "table_2", "table_A6", "table_A7"):
        table = pd.read_parquet(files[f"{name}.parquet"])
        csv = pd.read_csv(files[f"{name}.csv"])
        csv = csv[csv["patient"].isin(run.patients)].reset_index(drop=True)
        assert list(table) == list(csv) and len(table) == len(csv) >= 2
        for column in table.select_dtypes("number"):
            assert np.allclose(table[column], csv[column].astype(float), equal_nan=True), (name, column)


def test_jupyter_shows_run_and_patient(run: cardiotwin.Run) -> None:
    table = run._repr_html_()
    assert table.count("<tr>") == 3 and "03-CoA" in table
    page = run.patients["01-CoA"]._repr_html_()
    assert page.startswith("<iframe srcdoc=") and "&lt;svg" in page


def test_progress_is_lines(folder: Path, run: cardiotwin.Run, capfd: pytest.CaptureFixture[str]) -> None:
    cardiotwin.Cohort(folder).run(progress=True, report=False)
    assert "01-CoA  done  personalised" in capfd.readouterr().err


def test_simulate_predict_and_sweep(folder: Path, run: cardiotwin.Run, elsewhere: Path) -> None:
    beat = cardiotwin.simulate("01-CoA", cohort=folder, set={"left_atrial_pressure_mmHg": 9.0})
    assert beat.ventricle.parameters["left_atrial_pressure_mmHg"] == 9.0
    assert beat.traces["pressure_mmHg"].max() == pytest.approx(beat.biomarkers["P_max_mmHg"], rel=1e-2)
    stent = cardiotwin.predict("01-CoA", cohort=folder, set={"peripheral_resistance_mmHg_s_per_mL": "-20%"})
    assert stent.table.loc["P_max_mmHg", "relative_change"] < 0 and stent.table["p5"].notna().any()
    found = cardiotwin.sweep(elsewhere / "gsa", samples=32, bounds={"n_Tm": (4, 6)})
    assert len(found.ranking) == 21 and len(found.indices) == 5 * 21
    with pytest.raises(cardiotwin.Error, match="has other settings"):
        cardiotwin.sweep(elsewhere / "gsa", samples=32, bounds={"n_Tm": (4, 7)})


def test_sweeps_without_a_folder_meet_no_earlier_one(elsewhere: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(elsewhere)
    first = cardiotwin.sweep(samples=8, bounds={"n_Tm": [4, 6]})
    other = cardiotwin.sweep(samples=8, bounds={"n_Tm": [4, 7]})
    again = cardiotwin.sweep(samples=8, bounds={"n_Tm": [4, 6]}, workers=1)
    assert first.folder == again.folder != other.folder
    assert again.ranking.equals(first.ranking) and not other.ranking.equals(first.ranking)
    assert {path.parent for path in (first.folder, other.folder)} == {Path("sweeps")}


def test_discover_names_the_hidden_effect(elsewhere: Path) -> None:
    shutil.copytree(EXAMPLES / "hidden-effect", elsewhere / "patient", ignore=shutil.ignore_patterns("discover"))
    found = cardiotwin.discover(elsewhere / "patient", run_dir=elsewhere / "searches")
    assert found.summary.startswith("The base model misses: atrial kick") and found.answer["schema_version"] == 1


def test_errors_have_the_programs_words(folder: Path, run: cardiotwin.Run, elsewhere: Path) -> None:
    with pytest.raises(cardiotwin.StoreError, match="nothing was run here yet"):
        _ = cardiotwin.Run(EXAMPLES / "early-end", elsewhere).status
    with pytest.raises(cardiotwin.UsageError, match="did you mean `Smax_ref_kPa`"):
        cardiotwin.simulate("01-CoA", cohort=folder, set={"Smax_ref": 1})
    with pytest.raises(cardiotwin.InputError, match="fidelity"):
        cardiotwin.Cohort(folder).run(settings={"solver.fidelity": "4d"}, yes=True)
    with pytest.raises(KeyError, match="the run has 01-CoA, 03-CoA"):
        run.patients["99-CoA"]
    with pytest.raises(cardiotwin.StoreError, match="no 3D beat"):
        _ = run.patients["01-CoA"].mesh
