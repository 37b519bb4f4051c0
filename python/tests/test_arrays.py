"""Twins and searches of arrays, without a folder."""

from __future__ import annotations

import gc
import tempfile
from pathlib import Path
from typing import Any

import cardiotwin
import numpy as np
import pandas as pd
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def traces(folder: Path) -> dict[str, Any]:
    pressure, volume = (pd.read_csv(folder / f"{name}.csv") for name in ("pressure", "volume"))
    return {
        "time_ms": pressure["time_ms"],
        "pressure_mmHg": pressure["pressure_mmHg"].tolist(),
        "volume_time_ms": volume["time_ms"].to_numpy(),
        "volume_mL": volume["volume_mL"],
    }


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_a_fit_of_arrays_is_that_of_the_folder(run: cardiotwin.Run, folder: Path, temporary: Path) -> None:
    arrays = traces(folder / "patients" / "01-CoA")
    patient = cardiotwin.fit(
        **arrays,
        cycle_length_ms=659,
        end_diastolic_pressure_mmHg=7.02,
        wall_volume_mL=120.9,
        left_atrial_pressure_mmHg=6.43,
        afterload={
            "characteristic_resistance_mmHg_s_per_mL": 0.0523,
            "peripheral_resistance_mmHg_s_per_mL": 0.4934,
            "compliance_mL_per_mmHg": 2.0263,
        },
        more={
            "measured": {
                "noise": {
                    "pressure_rms_mmHg": 1.0,
                    "pressure_correlation_ms": 12,
                    "volume_rms_mL": 2.5,
                    "volume_frames": np.int64(30),
                },
                "aortic_pressure": {"systolic_mmHg": 115.0, "diastolic_mmHg": 68.7, "sd_mmHg": 4.0},
                "forward_stroke_volume": {"volume_mL": 100.0, "sd_mL": 7.0},
                "diastasis": {"time_ms": 529, "volume_mL": 138.5, "sd_mL": 5.5},
            }
        },
        fidelity="reduced",
        settings={"workflow.until": "step2-verification", "posterior.enabled": False},
    )
    own = run.patients["01-CoA"].parameters.loc["step1", "value"]
    assert np.allclose(patient.parameters.loc["step1", "value"], own, rtol=1e-9)
    twin = patient.twin
    del patient
    gc.collect()
    assert twin.predict(compliance="+10 %", band=False)["SV_mL"].predicted > 50
    with pytest.raises(cardiotwin.StoreError, match="sampled no posterior"):
        _ = twin.posterior
    assert len(list(temporary.iterdir())) == 1
    del twin
    gc.collect()
    assert not list(temporary.iterdir())


def test_a_search_of_arrays_leaves_no_file(temporary: Path) -> None:
    found = cardiotwin.discover(
        **traces(EXAMPLES / "hidden-effect"),
        cycle_length_ms=1069,
        wall_volume_mL=103.3,
        effects=["atrial_kick"],
        seed=1,
    )
    assert "atrial kick" in found.summary and "<svg" in found.figure and "data:image/svg+xml" in found._repr_html_()
    assert not list(temporary.iterdir())


def test_what_is_wrong_with_arrays_is_said(temporary: Path) -> None:
    arrays = {"time_ms": [0, 1], "pressure_mmHg": [7.0, 8.0], "volume_mL": [120.0, 119.0], "cycle_length_ms": 800}
    for change, words in (
        ({"pressure": [1.0]}, r"^pressure: did you mean pressure_mmHg\?"),
        ({"cycle_length_ms": None}, "cycle_length_ms is missing"),
        ({"volume_mL": [120.0]}, r"volume_mL has shape \(1,\), expected one value for each time_ms, \(2,\)"),
        ({"pressure_mmHg": [7.0, np.nan]}, r"pressure_mmHg\[1\] is nan"),
        ({}, r"error: pressure.csv: found 2 samples|^pressure.csv: found 2 samples"),
    ):
        for function in (cardiotwin.fit, cardiotwin.discover):
            with pytest.raises(cardiotwin.InputError, match=words):
                function(**{**arrays, **change})
    with pytest.raises(cardiotwin.UsageError, match="a folder or arrays, not both"):
        cardiotwin.discover("patient", **arrays)
    assert not list(temporary.iterdir())


def test_a_table_becomes_a_patient_that_check_accepts(folder: Path, elsewhere: Path) -> None:
    patient = folder / "patients" / "03-CoA"
    both = [pd.read_csv(patient / f"{name}.csv").set_index("time_ms") for name in ("pressure", "volume")]
    table = both[0].join(both[1], how="outer").reset_index()
    assert table["volume_mL"].isna().any()
    measured = cardiotwin.Measurements.of(table, cycle_length_ms=917)
    (elsewhere / "cohort.toml").write_text('name = "one"\n')
    written = measured.write(elsewhere / "patients" / "P-1")
    for name, trace in zip(("pressure", "volume"), both, strict=True):
        again = pd.read_csv(written / f"{name}.csv").set_index("time_ms")
        assert np.array_equal(again.to_numpy(), trace.to_numpy()) and np.array_equal(again.index, trace.index)
    assert cardiotwin.Cohort(elsewhere).check()["problems"] == []
    with pytest.raises(cardiotwin.InputError, match="already exists"):
        measured.write(written)
    with pytest.raises(cardiotwin.InputError, match=r"no column pressure_mmHg: did you mean pressure\?"):
        cardiotwin.Measurements.of(table.rename(columns={"pressure_mmHg": "pressure"}), cycle_length_ms=917)
