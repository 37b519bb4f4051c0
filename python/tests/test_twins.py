"""Twins of a run: what they hold, what they predict, and what notebooks show of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cardiotwin
import numpy as np
import pytest


@pytest.fixture(scope="module")
def twin(run: cardiotwin.Run) -> cardiotwin.Twin:
    return run.patients["01-CoA"].twin


def test_patients_are_a_mapping(run: cardiotwin.Run, elsewhere: Path) -> None:
    patients = run.patients
    assert isinstance(patients, Mapping) and len(patients) == 2 and "01-CoA" in patients and "1" not in patients
    assert {name: patient.name for name, patient in patients.items()} == {n: n for n in ("01-CoA", "03-CoA")}
    assert patients.get("99-CoA") is None
    assert patients._ipython_key_completions_() == ["01-CoA", "03-CoA"]
    assert repr(patients).startswith("<2 patients of ") and "01-CoA (done), 03-CoA (done)" in repr(patients)
    assert patients._repr_html_().count("<tr>") == 3
    with pytest.raises(cardiotwin.UnknownNameError, match=r"^1-CoA: did you mean 01-CoA\?$"):
        patients["1-CoA"]
    with pytest.raises(AttributeError, match=r"^Patient has no attribute biomakers: did you mean biomarkers\?$"):
        _ = patients["01-CoA"].biomakers


def test_a_twin_has_values_with_units(run: cardiotwin.Run, twin: cardiotwin.Twin) -> None:
    patient = run.patients["01-CoA"]
    assert twin.step == "step3" and twin.personalised
    assert twin.biomarkers["SV_mL"] == twin.biomarkers.SV_mL == patient.biomarkers.loc["SV_mL", "step3"]
    assert twin.biomarkers.units["dPdt_max_mmHg_per_ms"] == "mmHg/ms"
    assert twin.biomarkers.frame().loc["SV_mL", "unit"] == "mL"
    stored = patient.parameters.loc["step3"]
    for name, row in stored.iterrows():
        assert twin.parameters[str(name)] == row["value"] and twin.parameters.units[str(name)] == row["unit"]
    assert twin.traces["pressure_mmHg"].max() == pytest.approx(twin.biomarkers["P_max_mmHg"], rel=1e-2)
    assert list(twin.traces.frame()) == list(twin.traces)
    assert "SV_mL" in twin._repr_html_() and "personalised" in repr(twin)


def test_a_beat_without_a_change_is_the_twin_s_own(twin: cardiotwin.Twin) -> None:
    beat = twin.beat()
    for name in ("P_max_mmHg", "SV_mL", "dPdt_max_mmHg_per_ms"):
        assert beat.biomarkers[name] == pytest.approx(twin.biomarkers[name], rel=1e-9)
    full = "peripheral_resistance_mmHg_s_per_mL"
    less = twin.beat(resistance="-20 %", beats=2)
    assert less.ventricle.parameters[full] == pytest.approx(0.8 * twin.parameters[full], rel=1e-12)
    assert less.answer["result"]["beats"] == 2
    assert twin.beat({full: 0.8 * twin.parameters[full]}, beats=2).biomarkers == less.biomarkers


def test_a_prediction_has_values_bands_and_traces(twin: cardiotwin.Twin, folder: Path) -> None:
    stent = twin.predict(resistance="-20 %")
    assert [change.name for change in stent.changes] == ["peripheral_resistance_mmHg_s_per_mL"]
    assert stent.changes[0].after == pytest.approx(0.8 * stent.changes[0].before)
    volume = stent["SV_mL"]
    assert volume.unit == "mL" and volume.predicted > volume.twin == twin.biomarkers["SV_mL"]
    assert volume.p5 < volume.p95 and volume.p5 <= volume.predicted <= volume.p95
    assert volume.predicted == pytest.approx(volume.twin * (1 + volume.relative_change))
    assert volume.known in ("size", "direction", "neither") and "other formulations" in stent.band_covers
    assert stent.band_covers in repr(stent) and stent.band_covers in stent._repr_html_()
    for traces, peak in ((stent.before, stent["P_max_mmHg"].twin), (stent.after, stent["P_max_mmHg"].predicted)):
        assert traces["pressure_mmHg"].max() == pytest.approx(peak, rel=1e-2)
    assert stent.before["pressure_mmHg"] == pytest.approx(twin.traces["pressure_mmHg"])
    assert (
        "SV_mL" in repr(stent)
        and "data:image/svg+xml" in stent._repr_html_()
        and "<svg" in stent.figure
        and stent.periodic
    )
    quick = twin.predict({"compliance_mL_per_mmHg": 1.5}, cycle_length="-5 %", band=False)
    assert len(quick.changes) == 2 and np.isnan(quick["SV_mL"].p5) and quick.band_covers == ""
    assert quick["SV_mL"].known == ""
    assert any("force-frequency" in remark for remark in quick.remarks)


def test_filling_follows_a_change_in_the_loop(twin: cardiotwin.Twin) -> None:
    loop, circuit = (twin.predict(resistance="-20 %", circulation=kind, band=False) for kind in ("closed", "open"))
    assert (loop.circulation, circuit.circulation) == ("closed", "open")
    assert loop.periodic and loop["EDV_mL"].relative_change != pytest.approx(circuit["EDV_mL"].relative_change)
    beat = twin.beat(circulation="closed")
    assert beat.answer["result"]["closed_loop"]["blood_volume_mL"] > beat.biomarkers["EDV_mL"]


def test_changes_are_refused_with_the_reason(twin: cardiotwin.Twin) -> None:
    for changes, words in (
        ({"resistance": 0.8}, r"needs its unit, peripheral_resistance_mmHg_s_per_mL=0.8"),
        ({"resistence": "-20 %"}, r"resistence: did you mean resistance"),
        ({"P_max_mmHg": 100}, "is a result of the beat"),
        ({"heart_rate": "+10 %"}, "say it by `cycle_length_ms`"),
        ({"compliance": "10 %"}, "has no sign"),
        ({}, "name what changes"),
    ):
        with pytest.raises(cardiotwin.UsageError, match=words):
            twin.predict(changes)
    with pytest.raises(cardiotwin.UsageError, match="changed twice"):
        twin.predict({"peripheral_resistance_mmHg_s_per_mL": "+10 %"}, resistance="-20 %")
    with pytest.raises(cardiotwin.UsageError, match="neither a number nor a share"):
        twin.beat(compliance_mL_per_mmHg="much")


def test_draws_are_those_of_the_run(run: cardiotwin.Run, twin: cardiotwin.Twin) -> None:
    posterior = twin.posterior
    stored = {tuple(row) for row in run.patients["01-CoA"].draws.to_numpy()}
    draws = posterior.sample(20, seed=1)
    rows = [tuple(row) for row in draws.values]
    assert len(draws) == 20 and len(set(rows)) == 20 and set(rows) <= stored
    assert np.array_equal(posterior.sample(20, seed=1).values, draws.values)
    assert not np.array_equal(posterior.sample(20, seed=2).values, draws.values)
    assert np.array_equal(draws["n_Tm"], draws.frame()["n_Tm"]) and draws.units["Ca50_ref_uM"] == "µM"
    with pytest.raises(
        cardiotwin.UsageError, match=r"101 draws are wanted, and the run stores 100; .*posterior.draws': 101"
    ):
        posterior.sample(101)
    assert len(posterior.sample(300, seed=1, replace=True)) == 300
    assert len(twin.ventricle.beats(draws)["SV_mL"]) == 20
    assert posterior["n_Tm"].p5 <= posterior["n_Tm"].p95
    with pytest.raises(KeyError, match=r"^Ca50: did you mean Ca50_ref_uM\?$"):
        posterior["Ca50"]
    with pytest.raises(AttributeError, match=r"^Posterior has no attribute smaple: did you mean sample\?$"):
        _ = posterior.smaple


def test_traces_for_xarray(twin: cardiotwin.Twin) -> None:
    xarray = pytest.importorskip("xarray")
    pressure = twin.traces.dataset()["pressure_mmHg"]
    assert isinstance(pressure, xarray.DataArray) and pressure.attrs["units"] == "mmHg"
    assert float(pressure.sel(time_ms=0)) == twin.traces["pressure_mmHg"][0]
