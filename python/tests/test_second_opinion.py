"""A second opinion on reported numbers: what `show --json` says, recomputed from raw files with NumPy alone.

Nothing of the program's code is used: biomarkers come from `traces.csv` of each simulation and from the patient's own traces,
differences and the verdict from both, motion from the surfaces of `heart.json`.

    CARDIOTWIN=target/release/cardiotwin python -m pytest --noconftest python/tests/test_second_opinion.py
    CARDIOTWIN_RUN=some/cohort …        # a cohort that has run already, in three dimensions, say
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

np = pytest.importorskip("numpy")

ROOT = Path(__file__).parents[2]
TOLERANCES = {"P_max": 5.0, "dPdt_max": 15.0, "dPdt_min": 15.0, "PTD90": 3.0, "SV": 5.0}
KEYS = {
    "P_max": "P_max_mmHg",
    "dPdt_max": "dPdt_max_mmHg_per_ms",
    "dPdt_min": "dPdt_min_mmHg_per_ms",
    "PTD90": "PTD90_ms",
    "SV": "SV_mL",
}


def program():
    named = os.environ.get("CARDIOTWIN") or shutil.which("cardiotwin")
    if not named:
        pytest.skip("no cardiotwin: name it in CARDIOTWIN")
    return str(Path(named).resolve())


def call(*arguments, accept=(0,)):
    done = subprocess.run([program(), *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode in accept, (arguments, done.returncode, done.stderr)
    return done.stdout


@pytest.fixture(scope="module")
def cohort(tmp_path_factory):
    if given := os.environ.get("CARDIOTWIN_RUN"):
        return Path(given)
    folder = tmp_path_factory.mktemp("opinion") / "cohort"
    call("init", folder)
    shutil.rmtree(folder / "patients")
    for patient in ("01-CoA", "05-CoA"):
        shutil.copytree(ROOT / "examples/coa-seven/patients" / patient, folder / "patients" / patient)
    # 7: done, but a twin is off
    call("run", folder, "--fidelity", "reduced", "--set", "posterior.enabled=false", "--no-report", accept=(0, 7))
    return folder


@pytest.fixture(scope="module")
def shown(cohort):
    patients = sorted(path.name for path in (cohort / "patients").iterdir() if (path / "patient.toml").is_file())
    return {patient: json.loads(call("show", patient, "--cohort", cohort, "--json")) for patient in patients}


def simulations(patient):
    """Name and record of each simulated beat."""
    for iteration in patient["iterations"]:
        if iteration.get("run"):
            yield f"step 1, {iteration['number']}", iteration["run"]
    if patient.get("verification"):
        yield "verification", patient["verification"]
    for iteration in patient.get("step3_iterations") or []:
        if iteration.get("run"):
            yield f"step 3, {iteration['number']}", iteration["run"]


def read(path):
    with open(path, encoding="utf-8") as lines:
        names = lines.readline().strip().split(",")
    values = np.genfromtxt(path, delimiter=",", skip_header=1)
    return {name: values[:, k] for k, name in enumerate(names)}


def crossing(t, p, level, i, step):
    """Time at which p falls below the level when one goes from sample i by steps."""
    while p[i] > level:
        i += step
    j = i - step
    return t[i] + (level - p[i]) / (p[j] - p[i]) * (t[j] - t[i])


def biomarkers(t, p, v):
    """Those of docs/models.md: derivatives are central differences, levels are crossed linearly."""
    rate = (p[2:] - p[:-2]) / (t[2:] - t[:-2])
    top = int(p.argmax())
    level = p.min() + 0.1 * (p.max() - p.min())
    return {
        "P_max_mmHg": p.max(),
        "dPdt_max_mmHg_per_ms": rate[: top - 1].max(),
        "dPdt_min_mmHg_per_ms": rate[top:].min(),
        "PTD90_ms": crossing(t, p, level, top, 1) - crossing(t, p, level, top, -1),
        "SV_mL": v.max() - v.min(),
        "ESV_mL": v.min(),
        "EDP_mmHg": p[0],
    }


def directory(record):
    return Path(record["directory"])


def test_biomarkers_of_each_simulated_beat(shown):
    n = 0
    for name, patient in shown.items():
        for beat, record in simulations(patient):
            traces = read(directory(record) / "traces.csv")
            mine = biomarkers(traces["time_ms"], traces["pressure_mmHg"], traces["volume_mL"])
            told = record["result"]["biomarkers"]
            for key, value in mine.items():
                # Files have nine digits; a peak between samples is a parabola's in neither.
                assert told[key] == pytest.approx(value, rel=2e-3, abs=1e-3), (name, beat, key)
                n += 1
    assert n > 20


def test_measured_biomarkers_are_those_of_the_patients_own_traces(shown, cohort):
    for name, patient in shown.items():
        folder = cohort / "patients" / name
        pressure, volume = read(folder / "pressure.csv"), read(folder / "volume.csv")
        mine = biomarkers(pressure["time_ms"], pressure["pressure_mmHg"], np.interp(
            pressure["time_ms"], volume["time_ms"], volume["volume_mL"]))
        told = patient["step0"]["result"]["measured"]
        for key in ("P_max_mmHg", "EDP_mmHg", "ESV_mL"):
            assert told[key] == pytest.approx(mine[key], rel=0.01), (name, key)
        # The patient's traces are resampled before they are read.
        for key in ("dPdt_max_mmHg_per_ms", "dPdt_min_mmHg_per_ms", "PTD90_ms", "SV_mL"):
            assert told[key] == pytest.approx(mine[key], rel=0.05), (name, key)


def test_differences_and_the_verdict_follow_from_both(shown):
    for name, patient in shown.items():
        measured = patient["step0"]["result"]["measured"]
        best = (patient.get("step3") or {}).get("best_iteration", 0)
        twin = patient["step3_iterations"][best - 1]["run"] if best else patient.get("verification")
        if not twin or not patient.get("verdict"):
            continue
        off = {}
        for short, tolerance in TOLERANCES.items():
            key = KEYS[short]
            percent = 100 * (twin["result"]["biomarkers"][key] - measured[key]) / measured[key]
            if abs(percent) > tolerance:
                off[short] = percent
        verdict = patient["verdict"]
        assert verdict["personalised"] == (not off), (name, off, verdict)
        assert set(verdict["off_percent"]) == set(off), name
        for short, percent in off.items():
            assert verdict["off_percent"][short] == pytest.approx(percent, rel=1e-3), (name, short)


def test_motion_is_that_of_the_walls_surfaces(shown):
    """Thickening and radius at half height, around the long axis, from the half of the wall that the picture shows.

    The picture's half is symmetric for a generated heart. Other hearts have no symmetry, and are left out.
    """
    n = 0
    for name, patient in shown.items():
        if patient["plan"]["step0"].get("own_mesh"):
            continue
        for beat, record in simulations(patient):
            file, motion = directory(record) / "heart.json", record["result"].get("motion")
            if not motion or not file.is_file():
                continue
            heart = json.loads(file.read_text())
            before, after = (radii(heart, state) for state in heart["states"][:2])
            thickening = 100 * ((after[1] - after[0]) / (before[1] - before[0]) - 1)
            radius = 100 * (after[1] / before[1] - 1)
            assert motion["wall_thickening_percent"] == pytest.approx(thickening, abs=4), (name, beat)
            assert motion["epicardial_radius_change_percent"] == pytest.approx(radius, abs=0.5), (name, beat)
            n += 1
    if n == 0:
        pytest.skip("no beat in three dimensions: CARDIOTWIN_RUN names a cohort that has some")


def radii(heart, state):
    """Area-weighted mean radii of the inner and of the whole outer wall around the axis, at half of its height [mm]."""
    axis = np.array(heart["long_axis"])
    begin, x = np.array(heart["states"][0]["points_mm"]), np.array(state["points_mm"])
    height = begin @ axis

    def nodes_and_weights(*surfaces):
        triangles = np.array([t for part in heart["parts"] if part["surface"] in surfaces for t in part["triangles"]])
        corners = begin[triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 6
        weight = np.zeros(len(begin))
        for k in range(3):
            np.add.at(weight, triangles[:, k], area)
        return weight

    inner, rim = nodes_and_weights("endocardium"), nodes_and_weights("rim")
    base = (height * rim).sum() / rim.sum()
    inside = height[inner > 0]
    apex = inside[np.abs(inside - base).argmax()]
    level = (height - apex) / (base - apex)
    across = np.linalg.norm(x - np.outer(x @ axis, axis), axis=1)
    near = np.clip(1 - np.abs(level - 0.5) / 0.125, 0, None)
    return [(across * weight * near).sum() / (weight * near).sum() for weight in (inner, nodes_and_weights("epicardium", "septum"))]

