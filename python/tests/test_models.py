"""Cells and ventricles in this process."""

from __future__ import annotations

import multiprocessing
import shutil
import subprocess
import sys
from pathlib import Path

import cardiotwin
import numpy as np
import pytest


def sets(n: int, lower: list[float], upper: list[float]) -> np.ndarray:
    return np.random.default_rng(1).uniform(lower, upper, size=(n, len(lower)))


NAMES = ["Ca50_ref_uM", "Ca_max_uM"]


def test_a_batch_of_cells_equals_single_beats() -> None:
    values = sets(40, [0.6, 0.5], [1.0, 0.8])
    batch = cardiotwin.cell_beats(values, NAMES)
    assert batch.biomarkers.shape == (40, 6) and set(batch.status) == {"periodic"}
    assert batch.names[0] == "Sa_max_kPa" and batch.units[0] == "kPa"
    for row, single in zip(values, batch.biomarkers, strict=True):
        beat = cardiotwin.cell_beat(dict(zip(NAMES, row, strict=True)))
        np.testing.assert_allclose(beat.biomarkers.array(), single, rtol=1e-12)
    assert np.array_equal(cardiotwin.cell_beats(values, NAMES, threads=1).biomarkers, batch.biomarkers)


def test_traces_of_a_cell_hold_its_biomarkers() -> None:
    beat = cardiotwin.cell_beat({"Ca50_ref_uM": 0.7})
    assert list(beat.traces) == ["time_ms", "Sa_kPa", "Ca_uM", "lambda"]
    assert beat.traces["Sa_kPa"].max() == pytest.approx(beat.biomarkers["Sa_max_kPa"], rel=1e-9)
    assert beat.traces["lambda"].min() == pytest.approx(beat.biomarkers["lambda_min"], rel=1e-9)


def test_defaults_are_those_of_the_vocabulary() -> None:
    table = cardiotwin.cell_parameters()
    assert len(table) == 22 and table.loc["Ca50_ref_uM", "default"] == 0.805
    stated = cardiotwin.cell_beat(dict(table["default"]))
    assert stated.biomarkers == cardiotwin.cell_beat().biomarkers


def test_a_cell_without_meaning_is_a_row_and_alone_an_error() -> None:
    batch = cardiotwin.cell_beats([[0.25], [1.5]], ["r_S"])
    assert list(batch.status) == ["periodic", "refused"] and np.isnan(batch.biomarkers[1]).all()
    with pytest.raises(cardiotwin.ModelError, match="r_S"):
        cardiotwin.cell_beat({"r_S": 1.5})


def test_unknown_names_and_shapes_are_refused_with_what_is_known() -> None:
    with pytest.raises(cardiotwin.ModelError, match=r"no parameter Ca50: did you mean Ca50_ref_uM\?"):
        cardiotwin.cell_beat({"Ca50": 0.8})
    with pytest.raises(cardiotwin.ModelError, match=r"no parameter Smax: did you mean Smax_ref_kPa\?"):
        cardiotwin.Ventricle.average().beats([[1.0]], ["Smax"])
    with pytest.raises(cardiotwin.ModelError, match=r"no parameter `zeal`; it has .*Smax_ref_kPa"):
        cardiotwin.Ventricle.average().beat({"zeal": 1.0})
    with pytest.raises(cardiotwin.ModelError, match=r"shape \(3,\), expected \(number of sets, 1\)"):
        cardiotwin.cell_beats([1.0, 2.0, 3.0], ["n_Tm"])


def test_a_batch_of_beats_equals_single_beats_on_any_number_of_threads() -> None:
    ventricle = cardiotwin.Ventricle.average()
    names = ["Smax_ref_kPa", "left_atrial_pressure_mmHg", "unloaded_volume_mL"]
    values = sets(30, [90, 6, 65], [140, 10, 75])
    batch = ventricle.beats(values, names)
    assert set(batch.status) == {"finished"} and batch.valves_opened is not None and batch.valves_opened.all()
    for row, column in zip(values, batch["P_max_mmHg"], strict=True):
        beat = ventricle.beat(dict(zip(names, row, strict=True)))
        assert beat.biomarkers["P_max_mmHg"] == column
        assert beat.traces["pressure_mmHg"].max() == pytest.approx(column, rel=1e-3)
    again = ventricle.beats(values, names, threads=1)
    assert np.array_equal(again.biomarkers, batch.biomarkers, equal_nan=True)


def test_the_cell_in_the_organ() -> None:
    ventricle = cardiotwin.Ventricle.average().with_cell({"Ca50_ref_uM": 0.5, "Smax_ref_kPa": 200}, lambda_0=1.1)
    assert ventricle.parameters["Ca50_ref_uM"] == 0.5 and ventricle.parameters["n_Tm"] == 5.0
    weak, strong = ventricle.beats([[150.0], [250.0]], ["Smax_ref_kPa"])["P_max_mmHg"]
    assert weak < strong
    refused = ventricle.beats([[1.5]], ["r_S"])
    assert refused.status[0] == "refused" and refused.refused and "r_S" in refused.refused[0]


def test_a_specification_makes_the_same_ventricle() -> None:
    ventricle = cardiotwin.Ventricle.average().changed({"compliance_mL_per_mmHg": 1.2}, beats=2)
    same = cardiotwin.Ventricle(ventricle.specification)
    assert same.parameters == ventricle.parameters
    assert same.beat().answer["beats"] == 2
    with pytest.raises(cardiotwin.ModelError, match="not the specification of a beat"):
        cardiotwin.Ventricle({"cycle_length_ms": 800})


def maximum(stress: float) -> float:
    return float(cardiotwin.Ventricle.average().beats([[stress]], ["Smax_ref_kPa"])["P_max_mmHg"][0])


def test_forked_processes_have_threads_of_their_own() -> None:
    stresses = [100.0, 120.0]
    here = [maximum(stress) for stress in stresses]
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map(maximum, stresses) == here


def test_sources_without_the_compiled_part_say_what_to_do(tmp_path: Path) -> None:
    shutil.copytree(Path(__file__).parents[1] / "cardiotwin", tmp_path / "cardiotwin")
    done = subprocess.run([sys.executable, "-c", "import cardiotwin"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode != 0 and "no compiled part" in done.stderr and "make wheel" in done.stderr
