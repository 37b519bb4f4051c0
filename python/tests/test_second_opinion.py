"""A second opinion on reported numbers: `show --json`, `export`, `run` and the report, from raw files with NumPy.

Nothing of the program's code is used: `recomputed.py` has the formulas of the documents.
Kinds of patients: a reduced ventricle, and a generated mesh of 500 nodes. With CARDIOTWIN_OPINION=all also all steps
on such a mesh, a patient's own mesh with a septum, a mesh of both ventricles, and a cohort with simulations that fail.

    CARDIOTWIN=target/release/cardiotwin python -m pytest --noconftest python/tests/test_second_opinion.py
    CARDIOTWIN_RUN=some/cohort …        # a cohort that has run already
"""

import csv
import html
import json
import os
import re
import sqlite3
import sys
from pathlib import Path

import pytest

np = pytest.importorskip("numpy")
sys.path.insert(0, str(Path(__file__).parent))
import recomputed as mine  # noqa: E402
from opinion import (  # noqa: E402
    BIOMARKERS,
    TABLE_2,
    TOLERANCES,
    Case,
    Dashboard,
    beats,
    call,
    cohort,
    directory,
    kinds,
    law_file,
    measured,
    recomputed_beat,
    same,
    simulations,
    simulations_of,
)

# Largest relative difference of a posterior's quantiles from those of beats that are simulated again.
BANDS = 2e-3


@pytest.fixture(scope="module", params=kinds())
def case(request, tmp_path_factory):
    if request.param == "given":
        return Case("given", Path(os.environ["CARDIOTWIN_RUN"]))
    return Case(request.param, cohort(request.param, tmp_path_factory.mktemp("opinion") / "cohort"))


def test_biomarkers_of_each_simulated_beat(case):
    n = 0
    for name, patient in case.shown.items():
        for beat, record in simulations(patient):
            own = recomputed_beat(patient, record)
            told = record["result"]["biomarkers"]
            for key in BIOMARKERS:
                if told.get(key) is not None:
                    same(told[key], own[key], (name, beat, key), rel=2e-4)
                    n += 1
            for key, value in record["result"]["time_points"].items():
                if value is not None and key != "t2_ms":
                    same(value, own[key], (name, beat, key), low=0.05)
    assert n >= 10


def test_samples_and_volume_balance_of_each_simulated_beat(case):
    for name, patient in case.shown.items():
        cycle = patient["plan"]["step0"]["cycle_length_ms"]
        for beat, record in simulations(patient):
            traces = mine.columns(directory(record) / "traces.csv")
            for key, values in record["result"]["samples"].items():
                own = np.interp(np.arange(40) * cycle / 40, traces["time_ms"], traces[key])
                assert np.allclose(values, own, rtol=1e-6, atol=1e-5), (name, beat, key)
            found = next(c["found"] for c in record["result"]["checks"] if c["name"] == "volume balance")
            solver = patient["plan"]["settings"]["solver"]
            is_controlled = (
                solver["fidelity"] == "finite-element" and solver["finite_element"].get("longest_step_ms", 4) > 0
            )
            flows = traces["mitral_flow_mL_per_s"], traces["aortic_flow_mL_per_s"]
            own = mine.volume_balance(traces["time_ms"], traces["volume_mL"], *flows, is_controlled)
            # Where steps were cut, the file lacks the flows between its samples.
            low = 0.02 if record["result"]["counters"]["cut_steps"] == 0 else 0.2
            if is_controlled:
                # The same with shorter steps between samples: a valve may move anywhere in an interval.
                interval_s = np.diff(traces["time_ms"]).max() / 1000
                low = max(low, 0.5 * interval_s * max(np.abs(flow).max() for flow in flows))
            same(float(found.split()[0]), abs(own), (name, beat, "volume balance"), low=low)


def test_measured_biomarkers_are_those_of_the_patients_own_traces(case):
    for name, patient in case.shown.items():
        folder, cycle = case.folder / "patients" / name, patient["plan"]["step0"]["cycle_length_ms"]
        if patient["step0"]["result"].get("noise_windows"):
            continue
        traces = []
        for file, column in (("pressure.csv", "pressure_mmHg"), ("volume.csv", "volume_mL")):
            columns = mine.columns(folder / file) if (folder / file).is_file() else None
            traces.append(columns and (columns["time_ms"], columns[column]))
        own = mine.biomarkers(*traces, period=cycle)
        given = {k: v for k, v in patient["plan"]["step0"]["biomarkers"].items() if v is not None}
        # Numbers that the patient's file states have precedence.
        text = (folder / "patient.toml").read_text(encoding="utf-8")
        for key, stated in (("EDP_mmHg", "end_diastolic_pressure_mmHg"), ("EDV_mL", "end_diastolic_volume_mL")):
            if match := re.search(rf"^{stated} = ([\d.]+)", text, re.MULTILINE):
                given[key] = float(match[1])
        told = measured(patient)
        assert set(own) & set(BIOMARKERS) <= set(told), name
        for key, value in told.items():
            same(value, given.get(key, own.get(key)), (name, key), rel=1e-6)


def test_errors_costs_and_the_choice_of_step_1(case):
    for name, patient in case.shown.items():
        settings = patient["plan"]["settings"]["step1"]
        costs = {}
        for iteration in patient["iterations"]:
            if not iteration.get("run"):
                continue
            own = mine.differences(measured(patient), recomputed_beat(patient, iteration["run"]))
            for key, value in iteration["relative_differences"].items():
                same(value, own[key], (name, iteration["number"], key), low=5e-4)
            costs[iteration["number"]] = sum(x * x for x in own.values())
            same(iteration["cost"], costs[iteration["number"]], (name, iteration["number"], "cost"), rel=2e-3)
        for iteration in [*patient["iterations"], *(patient.get("step3_iterations") or [])]:
            if iteration.get("proposal"):
                told = iteration["proposal"]["result"]
                own = mine.differences(measured(patient), told["predicted"])
                same(told["predicted_cost"], sum(x * x for x in own.values()), (name, "predicted cost"), rel=1e-6)
        step1 = patient["step1"]
        same(step1["cost"], costs[step1["best_iteration"]], (name, "cost"), rel=2e-3)
        within = [number for number, cost in costs.items() if cost <= settings["tolerance"]]
        assert step1["first_converged"] == (min(within) if within else None), name
        assert (step1["quality"]["quality"] == "converged") == (step1["best_iteration"] in within), name
        if patient.get("verification"):
            own = mine.differences(measured(patient), recomputed_beat(patient, patient["verification"]))
            same(patient["verification_cost"], sum(x * x for x in own.values()), (name, "verification"), rel=2e-3)


def test_predicted_misfits_and_steps_of_proposals(case):
    n = 0
    for name, patient in case.shown.items():
        first = {iteration["number"]: iteration for iteration in patient["iterations"]}
        for number, iteration in first.items():
            if not iteration.get("proposal"):
                continue
            told, where = iteration["proposal"]["result"], (name, "step 1", number)
            spec = json.loads((directory(iteration["proposal"]) / "spec.json").read_text(encoding="utf-8"))["task"]
            own = mine.weighted(measured(patient), told["predicted"], spec.get("weights") or {})
            same(told["predicted_misfit"], own, (*where, "predicted misfit"), rel=1e-6, low=1e-12)
            # The change of a proposal that starts from a simulation, as the logarithm of the parameters.
            base = first.get(told.get("from_iteration"))
            if base and told.get("step") is not None:
                old, new = (flat(found["parameters"]) for found in (base, iteration))
                change = max(abs(np.log(new[key] / old[key])) for key in new if old[key] > 0 and new[key] > 0)
                same(told["step"], change, (*where, "step"), rel=1e-6)
                assert told["trust_radius"] is None or change <= told["trust_radius"] * (1 + 1e-9), where
            # What the run is told of its iterations is what they gave.
            for run, before in zip(spec.get("runs") or [], patient["iterations"], strict=False):
                found = before.get("run")
                assert (run.get("biomarkers") is not None) == (found is not None), where
                if found:
                    told_run = {k: v for k, v in run["biomarkers"].items() if v is not None and k in BIOMARKERS}
                    beat = recomputed_beat(patient, found)
                    for key, value in told_run.items():
                        same(value, beat[key], (*where, key), rel=2e-4)
            n += 1
        percent = patient["plan"]["settings"]["step3"]["uncertainty_percent"]
        proposals = [(i["number"], i["proposal"]) for i in patient.get("step3_iterations") or [] if i.get("proposal")]
        if patient.get("organ_fit"):
            proposals.append(("in the organ's law", patient["organ_fit"]))
        for number, proposal in proposals:
            told = proposal["result"]
            spec = json.loads((directory(proposal) / "spec.json").read_text(encoding="utf-8"))["task"]
            own = mine.misfit(measured(patient), told["predicted"], percent, {}, {}, {}, 0)
            # The predicted traces are not stored, so only their share of the misfit cannot be recomputed.
            if spec.get("traces"):
                assert told["predicted_misfit"] >= own * (1 - 1e-9), (name, number, "predicted misfit")
            else:
                same(told["predicted_misfit"], own, (name, number, "predicted misfit"), rel=1e-6)
            n += 1
    if n == 0:
        pytest.skip("no proposal")


def flat(value):
    """Numbers of nested tables by their innermost names."""
    found = {}
    for key, inner in value.items():
        if isinstance(inner, dict):
            found |= flat(inner)
        elif isinstance(inner, (int, float)) and not isinstance(inner, bool):
            found[key] = inner
    return found


def test_misfits_and_the_choice_of_step_3(case):
    for name, patient in case.shown.items():
        if not patient.get("step3"):
            continue
        settings, step0 = patient["plan"]["settings"]["step3"], patient["step0"]["result"]

        def misfit(record, patient=patient, settings=settings, step0=step0):
            own, cycle = recomputed_beat(patient, record), patient["plan"]["step0"]["cycle_length_ms"]
            traces = mine.columns(directory(record) / "traces.csv")
            at = np.arange(40) * cycle / 40
            samples = {key: np.interp(at, traces["time_ms"], traces[key]) for key in ("pressure_mmHg", "volume_mL")}
            percent, deviations = settings["uncertainty_percent"], settings["trace_deviations"]
            return mine.misfit(measured(patient), own, percent, step0["samples"], samples, deviations, cycle)

        misfits = {0: misfit(patient["verification"])}
        for iteration in patient.get("step3_iterations") or []:
            if iteration.get("run"):
                misfits[iteration["number"]] = misfit(iteration["run"])
                same(iteration["misfit"], misfits[iteration["number"]], (name, iteration["number"], "misfit"), rel=2e-3)
        best = patient["step3"]["best_iteration"]
        assert misfits[best] == min(misfits.values()), (name, misfits)
        same(patient["step3"]["misfit"], misfits[best], (name, "misfit"), rel=2e-3)


def test_the_verdict_follows_from_both_traces(case):
    for name, patient in case.shown.items():
        twin = beats(patient).get("step3") or patient.get("verification")
        if not twin or not patient.get("verdict"):
            continue
        own, real, off = recomputed_beat(patient, twin), measured(patient), {}
        for short, tolerance in TOLERANCES.items():
            if TABLE_2[short] in real:
                percent = 100 * (own[TABLE_2[short]] / real[TABLE_2[short]] - 1)
                if abs(percent) > tolerance:
                    off[short] = percent
        verdict = patient["verdict"]
        assert verdict["personalised"] == (not off), (name, off, verdict)
        assert set(verdict["off_percent"]) == set(off), name
        for short, percent in off.items():
            same(verdict["off_percent"][short], percent, (name, short), low=0.02)


def test_targets_are_the_medians_over_the_nodes(case):
    for name, patient in case.shown.items():
        if not patient.get("targets"):
            continue
        told = patient["targets"]["result"]
        t, activation, weight, traces = mine.nodal(directory(beats(patient)["step1"]) / "nodal.csv")
        times, stress = mine.medians(t, activation, weight, traces["Sa_kPa"])
        _, stretch = mine.medians(t, activation, weight, traces["lambda"])
        for key, value in mine.stress(times, stress, stretch).items():
            same(told["targets"][key], value, (name, key))
        same(told["lambda_0"], stretch[0], name)
        same(told["lambda_max"], traces["lambda"].max(), name)
        assert told["n_nodes"] == len(activation), name
        for beat, record in simulations(patient):
            file = directory(record) / "nodal.csv"
            if file.is_file():
                least = mine.nodal(file)[3]["lambda"].min()
                same(record["result"]["lambda_min"], least, (name, beat, "lambda_min"), low=2e-4)


def test_the_fitted_cell_and_its_cost(case):
    for name, patient in case.shown.items():
        if not patient.get("cell_fit"):
            continue
        told = patient["cell_fit"]["result"]
        cell = mine.columns(directory(patient["cell_fit"]) / "cell.csv")
        values = {p["name"]: p["value"] for p in told["parameters"]}
        lambda_max = patient["targets"]["result"]["lambda_max"]
        targets = patient["targets"]["result"]["targets"]
        reached, terms = mine.cell_cost(cell["time_ms"], cell["Sa_kPa"], cell["lambda"], targets, values, lambda_max)
        for key, value in reached.items():
            same(told["targets"][key], targets[key], (name, key))
            same(told["reached"][key], value, (name, key))
        for key, value in told["cost_terms"].items():
            same(value, terms[key], (name, key), rel=5e-3, low=1e-6)
        same(told["cost"], sum(terms.values()), (name, "cost"), rel=5e-3)
        for p in told["parameters"]:
            near = min(p["value"] - p["lower"], p["upper"] - p["value"]) / (p["upper"] - p["lower"])
            assert p["at_bound"] == (near <= 1e-3), (name, p)


def test_intervals_are_those_of_the_draws(case):
    n = 0
    for name, patient in case.shown.items():
        if not patient.get("posterior"):
            continue
        told = patient["posterior"]["result"]
        draws = np.array(told["draws"])
        assert len(draws) >= 20, name
        for k, (key, spread) in enumerate(told["parameters"].items()):
            own, width = mine.interval(draws[:, k])
            for end, value in own.items():
                same(spread["posterior"][end], value, (name, key, end), rel=1e-9)
            prior = abs(np.log(spread["prior"]["p95"] / spread["prior"]["p5"]))
            share = width / prior
            mark = "determined" if share <= 1 / 3 else "sloppy" if share < 0.8 else "not-determined"
            assert spread["mark"].replace(" ", "-") == mark, (name, key, share)
            n += 1
        own = np.corrcoef(np.log(np.abs(draws.T)))
        assert np.allclose(told["correlations"], own, atol=1e-4), name
        # The model's error: squares beyond the noise, each averaged over a correlation time to either side.
        settings, cycle = patient["plan"]["settings"]["posterior"], patient["plan"]["step0"]["cycle_length_ms"]
        twin = beats(patient).get("step3") or patient["verification"]
        traces = mine.columns(directory(twin) / "traces.csv")
        noise = told["deviations"]["noise"]
        for key, rms in (("pressure_mmHg", noise["pressure_rms_mmHg"]), ("volume_mL", noise["volume_rms_mL"])):
            samples = patient["step0"]["result"]["samples"].get(key)
            if not samples:
                continue
            square = (np.interp(np.arange(40) * cycle / 40, traces["time_ms"], traces[key]) - samples) ** 2
            reach = min(round(settings["discrepancy_correlation_ms"] * 40 / cycle), 19)
            local = np.mean([np.roll(square, k) for k in range(-reach, reach + 1)], axis=0)
            own = np.sqrt(np.maximum(local - rms**2, 0).mean())
            quantity, unit = key.split("_")
            same(told["deviations"][f"{quantity}_discrepancy_{unit}"], own, (name, key), rel=1e-3)
    if n == 0:
        pytest.skip("no posterior")


def test_motion_is_that_of_the_whole_wall(case):
    n = 0
    for name, patient in case.shown.items():
        mesh = case.mesh(name)
        for beat, record in simulations(patient):
            told, series = record["result"].get("motion"), directory(record) / "vtu/beat.pvd"
            if mesh is None or not told or not series.is_file():
                continue
            frames = mine.Frames(series.parent)
            if len(frames.time) < 20:
                continue
            assert np.array_equal(frames.tets, mesh.tets), (name, "the export's mesh is the beat's")
            pressure = mine.columns(directory(record) / "traces.csv")["pressure_mmHg"]
            times = record["result"]["time_points"]
            own = mine.motion(mesh, frames, times, pressure)
            for key, value in told.items():
                # Volumes of elements are looked at every fifth sample by the program.
                low = 5e-3 if key.endswith("volume_ratio") else 0.02
                same(value, own[key], (name, beat, key), rel=2e-3, low=low)
            n += 1
    if n == 0:
        pytest.skip("no series of a beat in three dimensions")


def test_volumes_are_those_of_the_mesh(case):
    n = 0
    for name, patient in case.shown.items():
        mesh, organ = case.mesh(name), patient["step0"]["result"]["organ"]
        if mesh is None:
            continue
        figures = organ["figures"]
        inner = mesh.surfaces["endocardium"]
        same(figures["mean_edge_mm"], mine.edges(mesh.image, mesh.tets).mean(), (name, "edges"))
        assert figures["nodes"] == len(mesh.image) and figures["elements"] == len(mesh.tets), name
        same(figures["image_volume_mL"], mine.cavity(mesh.image, inner), (name, "image"))
        same(figures["unloaded_volume_mL"], mine.cavity(mesh.unloaded, inner), (name, "unloaded"))
        wall = mine.volumes(mesh.image, mesh.tets)
        same(figures["wall_volume_mL"], wall[mesh.tags == 1].sum() / 1000, (name, "contracting wall"))
        for beat, record in simulations(patient):
            series = directory(record) / "vtu/beat.pvd"
            if series.is_file():
                frames = mine.Frames(series.parent)
                traces = mine.columns(directory(record) / "traces.csv")
                own = [mine.cavity(x, inner) for x in frames.x]
                told = np.interp(frames.time, traces["time_ms"], traces["volume_mL"])
                assert np.allclose(told, own, atol=0.01), (name, beat)
                same(figures["end_diastolic_volume_mL"], own[0], (name, beat), rel=1e-3)
                n += 1
    if n == 0:
        pytest.skip("no mesh")


# ------------------------------------------------------------------------------------- tables, times and the report


def rows(case, table):
    with open(case.exported / f"{table}.csv", encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def test_table_2_and_its_means(case):
    found = rows(case, "table_2")
    columns = [key for key in found[0] if key not in ("patient", "row")]
    values = {}
    for name, patient in case.shown.items():
        real, steps = measured(patient), beats(patient)
        own = {"measured": real}
        for step in ("step1", "step2", "step3"):
            own[step] = recomputed_beat(patient, steps[step]) if step in steps else {}
            pairs = {key: (own[step].get(key), real.get(key)) for key in columns}
            own[f"{step}_difference_percent"] = {
                key: 100 * abs(a / b - 1) for key, (a, b) in pairs.items() if None not in (a, b) and b
            }
        for row in (row for row in found if row["patient"] == name):
            for key in columns:
                if row[key]:
                    same(float(row[key]), own[row["row"]][key], (name, row["row"], key), rel=5e-4, low=0.02)
                    values.setdefault((row["row"], key), []).append(float(row[key]))
            if row["row"] == "measured":
                assert {key for key in columns if row[key]} == {key for key in columns if real.get(key) is not None}
    check_means(found, values)


def check_means(found, values):
    for row in found:
        if row["patient"] not in ("mean", "SD", "n"):
            continue
        for (kind, key), numbers in values.items():
            if row.get("row") != kind:
                continue
            own = {
                "mean": np.mean(numbers),
                "SD": np.std(numbers, ddof=1) if len(numbers) > 1 else None,
                "n": len(numbers),
            }
            if own[row["patient"]] is None:
                assert row[key] == "", (key, row)
            else:
                assert float(row[key]) == pytest.approx(own[row["patient"]], rel=1e-9, abs=1e-9), (kind, key)


def test_tables_1_a6_and_a7(case):
    values = {}
    for row in rows(case, "table_1"):
        patient = case.shown.get(row["patient"])
        if not patient:
            continue
        runs = [i["run"] for i in patient["iterations"] if i.get("run")]
        own = {
            "cycle_length_ms": patient["plan"]["step0"]["cycle_length_ms"],
            "iterations_step1": len(patient["iterations"]),
            "iteration_taken_step1": patient["step1"]["best_iteration"],
            "cost_step1": patient["step1"]["cost"],
            "time_per_iteration_step1_s": np.mean([outcome(run)["provenance"]["wall_s"] for run in runs]),
            "wall_time_s": computing(case, row["patient"]),
        }
        if mesh := case.mesh(row["patient"]):
            own |= {"nodes": len(mesh.image), "elements": len(mesh.tets)}
        if fit := patient.get("cell_fit"):
            own |= {
                "evaluations_step2": fit["result"]["evaluations"],
                "cost_step2": fit["result"]["cost"],
                "time_per_evaluation_step2_s": outcome(fit)["provenance"]["wall_s"] / fit["result"]["evaluations"],
            }
        for key, value in own.items():
            same(float(row[key]), value, (row["patient"], key), rel=1e-9)
            values.setdefault((None, key), []).append(float(row[key]))
    check_means(rows(case, "table_1"), values)
    for row in rows(case, "table_A6"):
        if patient := case.shown.get(row["patient"]):
            told = beats_parameters(patient)
            for key, value in row.items():
                if key not in ("patient", "quality") and not key.endswith("_twin"):
                    same(float(value), told[key], (row["patient"], key), rel=1e-9)
            check_twin(row, patient)
    for row in rows(case, "table_A7"):
        patient = case.shown.get(row["patient"])
        if patient and patient.get("cell_fit"):
            for p in patient["cell_fit"]["result"]["parameters"]:
                same(float(row[p["name"]]), p["value"], (row["patient"], p["name"]), rel=1e-9)
            check_twin(row, patient)


def check_twin(row, patient):
    """Columns of the twin: what step 3 moved, else what stands in the table."""
    moved = (patient.get("step3") or {}).get("parameters", {})
    for key, value in row.items():
        name = key.removesuffix("_twin")
        if name != key and name in moved:
            same(float(value), moved[name], (row["patient"], key), rel=1e-9)


def beats_parameters(patient):
    """Step 1's parameters, of the specification of the beat that was taken."""
    spec = json.loads((directory(beats(patient)["step1"]) / "spec.json").read_text(encoding="utf-8"))
    text = json.dumps(spec)

    def number(key):
        return float(re.search(rf'"{key}": ([-+.\de]+)', text)[1])

    names = ("Smax_ref_kPa", "tau_SR_ref_ms", "tau_SD_ms", "t_CR_ms")
    names += ("R_AV_f_mmHg_s_per_mL", "R_MV_f_mmHg_s_per_mL")
    return {name: number(name) for name in names}


def outcome(record):
    return json.loads((directory(record) / "outcome.json").read_text(encoding="utf-8"))


def computing(case, name):
    """Sum of the wall times of all outcomes of a patient, failed tasks included, from the attempts' folders; the run's
    database has the tasks of each patient."""
    if not hasattr(case, "walls"):
        case.walls = {}
        for file in (case.folder / "run/attempts").glob("*/*/outcome.json"):
            told = json.loads(file.read_text(encoding="utf-8"))
            if "provenance" in told:
                # The folder's name has the first digits of the task.
                case.walls[file.parent.name.rpartition("-g")[0]] = told["provenance"]["wall_s"]
        database = sqlite3.connect(f"file:{case.folder / 'run/cardiotwin.db'}?mode=ro", uri=True)
        case.tasks = {}
        for patient, task in database.execute(
            "SELECT patient, task FROM steps JOIN patients ON patient_id = patients.id"
        ):
            case.tasks.setdefault(patient, set()).add(task)
        database.close()
    keys = {key for key in case.walls for task in case.tasks[name] if task.startswith(key)}
    return sum(case.walls[key] for key in keys)


def duration(seconds):
    """As the report says it."""
    if seconds < 0.9995:
        return f"{1e3 * seconds:.0f} ms"
    return f"{seconds:.1f} s" if seconds < 99.95 else f"{seconds / 60:.1f} min"


def test_times_are_the_sum_of_all_outcomes(case):
    total = 0
    for name in case.shown:
        own = computing(case, name)
        total += own
        told = re.search(r"computed in ([^<]+)<", case.section(name))[1]
        assert told == duration(own), (name, told, own)
    told = case.folder / "told.txt"
    if told.is_file():
        shown = re.findall(r"(?:(\d+):(\d\d):(\d\d)|  ([\d.]+) s)$", told.read_text(encoding="utf-8"), re.MULTILINE)
        own = [computing(case, name) for name in case.shown]
        assert len(shown) == len(own), shown
        for (hours, minutes, seconds, alone), value in zip(shown, own, strict=True):
            clock = float(alone) if alone else 3600 * int(hours) + 60 * int(minutes) + int(seconds)
            assert clock == pytest.approx(value, abs=0.5 if not alone else 0.051), (shown, own)
    every = sum(case.walls.values())
    assert total == pytest.approx(every), "outcomes that no patient's time contains"
    assert f" {duration(total)} of computing" in case.report.replace("· ", " "), total


def text_of(cell):
    return html.unescape(re.sub(r"<[^>]+>", "", cell)).replace("−", "-").strip()


def table(section, caption):
    """Rows of a table of the report."""
    at = re.search(rf"<caption>{caption}[<]", section).start()
    body = section[section.index("<tbody>", at) : section.index("</tbody>", at)]
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.DOTALL) for row in body.split("<tr>")[1:]]


def test_the_reports_biomarkers_and_motion(case):
    n = 0
    for name, patient in case.shown.items():
        section, steps = case.section(name), beats(patient)
        own = {step: recomputed_beat(patient, beat) for step, beat in steps.items()}
        real = measured(patient)
        order = [step for step in ("step1", "step2", "step3") if step != "step3" or patient.get("step3")]
        keys = [key for key in BIOMARKERS if key in real or any(key in own[step] for step in steps)]
        told = table(section, "Biomarkers")
        assert len(told) == len(keys), (name, keys, [text_of(row[0]) for row in told])
        for key, row in zip(keys, told, strict=True):
            cells = [text_of(cell) for cell in row[2:]]
            digits = 3 if "dPdt" in key else 1
            check_shown(cells[0], real.get(key), digits, (name, key))
            for step, value, percent in zip(order, cells[1::2], cells[2::2], strict=True):
                simulated = own.get(step, {}).get(key)
                check_shown(value, simulated, digits, (name, step, key))
                if simulated is not None and real.get(key):
                    check_shown(
                        percent, 100 * (simulated - real[key]) / real[key], 1, (name, step, key, "%"), slack=0.03
                    )
                n += 1
        if any(beat["result"].get("motion") for beat in steps.values()):
            for key, row in zip(MOTION, table(section, "Motion"), strict=True):
                for step, cell in zip(order, row[2::2], strict=False):
                    motion = steps.get(step, {}).get("result", {}).get("motion") or {}
                    check_shown(text_of(cell), motion.get(key), 2 if "ratio" in key else 1, (name, step, key))
    assert n > 10


def test_the_reports_intervals(case):
    n = 0
    for name, patient in case.shown.items():
        if not patient.get("posterior"):
            continue
        told = patient["posterior"]["result"]
        draws = dict(zip(told["parameters"], np.array(told["draws"]).T, strict=True))
        for row in table(case.section(name), "Parameters, 90 % intervals"):
            key = re.search(r"\((\w+)\)", row[0])[1]
            own, _ = mine.interval(draws[key])
            low, high = (float(x) for x in text_of(row[2]).split(" to "))
            # Three significant digits.
            same([low, high], [own["p5"], own["p95"]], (name, key), rel=5.01e-3, low=1e-12)
            n += 1
    if n == 0:
        pytest.skip("no posterior")


def test_the_posteriors_bands_and_spreads(case, tmp_path):
    """Each draw is simulated again by itself: in the one-fibre ventricle, or in the organ's law of the run's beats. The
    difference from the beat with the twin's parameters moves the twin's own beat."""
    n = 0
    for name, patient in case.shown.items():
        if not patient.get("posterior"):
            continue
        told, cycle = patient["posterior"]["result"], patient["plan"]["step0"]["cycle_length_ms"]
        spec = json.loads((directory(patient["posterior"]) / "spec.json").read_text(encoding="utf-8"))["task"]
        law = law_file(spec, tmp_path / name)
        # The posterior's own steps.
        beat = spec["beat"] | {"time_step_ms": max(spec["beat"]["time_step_ms"], 4.0 if law else 2.0)}
        own, at = beats(patient).get("step3") or patient["verification"], np.arange(40) * cycle / 40
        real = measured(patient)

        def seen(traces, at=at, real=real):
            t, pressure, volume = (traces[key] for key in ("time_ms", "pressure_mmHg", "volume_mL"))
            curves = {key: np.interp(at, t, traces[key]) for key in ("pressure_mmHg", "volume_mL")}
            return curves, mine.biomarkers((t, pressure), (t, volume), real.get("EDV_mL"))

        twin = seen(mine.columns(directory(own) / "traces.csv"))
        draws = [dict(zip(told["parameters"], draw, strict=True)) for draw in told["draws"]]
        found = simulations_of(beat, [spec["twin"]["parameters"], *draws], tmp_path / name, law=law)
        assert all(traces is not None for traces in found), name
        cheap, *of_draws = map(seen, found)
        for key, band in told["biomarkers"].items():
            values = [twin[1][key] * draw[1][key] / cheap[1][key] for draw in of_draws]
            for p in (5, 50, 95):
                same(band[f"p{p}"], mine.quantile(values, p / 100), (name, key, p), rel=BANDS, low=0.1)
                n += 1
        for key in ("pressure_mmHg", "volume_mL"):
            curves = np.array([twin[0][key] + draw[0][key] - cheap[0][key] for draw in of_draws])
            for p in (5, 50, 95):
                own_at = [mine.quantile(values, p / 100) for values in curves.T]
                assert np.allclose(told[key][f"p{p}"], own_at, atol=0.3), (name, key, p)
                n += 1
    if n == 0:
        pytest.skip("no patient with a posterior")


def indices_of(traces, cycle):
    """What a treatment is judged by, of the traces of a beat."""
    t, pressure, volume, aorta = (
        traces[key] for key in ("time_ms", "pressure_mmHg", "volume_mL", "aortic_pressure_mmHg")
    )
    found = mine.biomarkers((t, pressure), (t, volume))
    work = 0.5 * ((pressure + np.roll(pressure, -1)) * (volume - np.roll(volume, -1))).sum()
    return {key: found[key] for key in ("EDV_mL", "ESV_mL", "SV_mL", *BIOMARKERS) if key in found} | {
        "ejection_fraction": found["SV_mL"] / found["EDV_mL"],
        "cardiac_output_L_per_min": 60 * found["SV_mL"] / cycle,
        "stroke_work_mJ": 0.133322387415 * work,
        "aortic_systolic_mmHg": aorta.max(),
        "aortic_diastolic_mmHg": aorta.min(),
        "aortic_mean_mmHg": aorta.mean(),
    }


def changes_of(twin, before, after):
    """Relative changes that are applied to the twin. ESV follows from EDV and from the stroke between both."""
    found = {key: after[key] / before[key] - 1 for key in before}
    strokes = [beat["EDV_mL"] - beat["ESV_mL"] for beat in (twin, before, after)]
    esv = twin["EDV_mL"] * (1 + found["EDV_mL"]) - strokes[0] * strokes[2] / strokes[1]
    return found | {"ESV_mL": esv / twin["ESV_mL"] - 1}


def test_predictions_are_the_twins_value_times_the_change(case, tmp_path):
    change = "peripheral_resistance_mmHg_s_per_mL"
    periodic = {"mode": "periodic", "max": 100, "tolerance": 0.05}
    for name, patient in case.shown.items():
        twin = beats(patient).get("step3") or beats(patient).get("step2")
        if not twin or patient["plan"]["step0"].get("fidelity") == "external":
            continue
        out = case.folder / "predicted"
        arguments = ("predict", name, "--cohort", case.folder, "--set", f"{change}=-20%", "--out", out, "--json")
        [told] = json.loads(call(*arguments, accept=(0, 1)))["predictions"]
        [changed] = told["changes"]
        same(changed["after"], 0.8 * changed["before"], (name, change), rel=1e-9)
        traces, cycle = mine.columns(directory(twin) / "traces.csv"), patient["plan"]["step0"]["cycle_length_ms"]
        own, indices = indices_of(traces, cycle), {index["name"]: index for index in told["indices"]}
        ends = [
            {key: index[f"simulated_{end}"] for key, index in indices.items() if index["simulated_after"] is not None}
            for end in ("before", "after")
        ]
        applied = changes_of(own, *ends)
        for key, index in indices.items():
            same(index["twin"], own[key], (name, key), rel=2e-4)
            if index["predicted"] is None:
                continue
            same(index["relative_change"], applied[key], (name, key, "change"), rel=1e-4, low=1e-6)
            same(index["predicted"], own[key] * (1 + applied[key]), (name, key, "predicted"), rel=3e-4)
            assert (index.get("band") is not None) == bool(patient.get("posterior")), (name, key)
            if index.get("band"):
                low, high = index["band"]
                assert low <= index["predicted"] <= high, (name, key, index)
        # The files draw what the table says.
        shown = mine.columns(out / f"{name}-before.csv")
        assert np.allclose(shown["pressure_mmHg"], traces["pressure_mmHg"]), name
        predicted = mine.columns(out / f"{name}-after.csv")
        for key, value in (
            ("P_max_mmHg", predicted["pressure_mmHg"].max()),
            ("EDV_mL", predicted["volume_mL"][0]),
            ("ESV_mL", predicted["volume_mL"].min()),
            ("aortic_systolic_mmHg", predicted["aortic_pressure_mmHg"].max()),
            ("aortic_diastolic_mmHg", predicted["aortic_pressure_mmHg"].min()),
        ):
            same(indices[key]["predicted"], value, (name, key, "of the curve"), rel=2e-3)
        if not patient.get("posterior"):
            continue
        # The periodic states and the band: the twin and each draw, unchanged and changed. The law's own error is added
        # to its bands, so only those of a one-fibre ventricle are those of the draws.
        spec = json.loads((directory(patient["posterior"]) / "spec.json").read_text(encoding="utf-8"))["task"]
        law, result = law_file(spec, tmp_path / name), patient["posterior"]["result"]
        sets = [spec["twin"]["parameters"]]
        if not law:
            sets += [dict(zip(result["parameters"], draw, strict=True)) for draw in result["draws"]]
        pairs = zip(
            simulations_of(spec["beat"], sets, tmp_path / name / "before", law=law, beats=periodic),
            simulations_of(
                spec["beat"], sets, tmp_path / name / "after", law=law, beats=periodic, change={change: 0.8}
            ),
            strict=True,
        )
        pairs = [tuple(indices_of(traces, cycle) for traces in pair) for pair in pairs]
        for key in ends[0]:
            for end, simulated in zip(ends, pairs[0], strict=True):
                # Cut steps are shorter than the samples of the file, which moves rates.
                same(end[key], simulated[key], (name, key, "periodic"), rel=2e-3, low=1e-3)
        draws = [changes_of(own, *pair) for pair in pairs[1:]]
        for key, index in indices.items():
            if draws and index.get("band"):
                low, middle, high = (mine.quantile([draw[key] for draw in draws], share) for share in (0.05, 0.5, 0.95))
                moved = sorted(own[key] * (1 + applied[key] + end - middle) for end in (low, high))
                same(index["band"], moved, (name, key, "band"), rel=5e-3)


def test_the_dashboards_numbers(case):
    """Its rows, its parts of patients, and its comparison with another run."""
    with Dashboard(case.folder, "--compare", case.folder) as dashboard:
        state = dashboard.state()
        rows = {row["patient"]: row for row in state["patients"]}
        assert rows.keys() == case.shown.keys() and state["whole"] and state["trouble"] is None
        states = [row["state"] for row in rows.values()]
        assert {key: n for key, n in state["counts"].items() if n} == {key: states.count(key) for key in set(states)}
        for name, patient in case.shown.items():
            row, real = rows[name], measured(patient)
            costs = {}
            for iteration in patient["iterations"]:
                if iteration.get("run"):
                    own = mine.differences(real, recomputed_beat(patient, iteration["run"]))
                    costs[iteration["number"]] = sum(x * x for x in own.values())
            same(row["step1_cost"], min(costs.values()), (name, "step1_cost"), rel=2e-3)
            assert row["iteration"][0] == len(patient["iterations"]), name
            if patient.get("cell_fit"):
                same(row["step2_cost"], sum(patient["cell_fit"]["result"]["cost_terms"].values()), (name, "step2_cost"))
            twin = beats(patient).get("step3") or patient.get("verification")
            if row["state"] == "done" and twin and patient.get("verdict"):
                own = recomputed_beat(patient, twin)
                off = {
                    short: 100 * (own[key] / real[key] - 1)
                    for short, key in TABLE_2.items()
                    if key in real and abs(100 * (own[key] / real[key] - 1)) > TOLERANCES[short]
                }
                gap = abs(own["end_of_beat_gap_mL"]) > 0.2 * real["SV_mL"] if "SV_mL" in real else False
                assert ("not personalised" in row["note"]) == bool(off or gap), (name, row["note"], off)
                for short, percent in off.items():
                    assert f"{short} {abs(percent):.0f} % " in row["note"], (name, row["note"], percent)
            # A patient's part is the report's, whose numbers other tests recompute.
            page = dashboard.json(f"/api/patient/{name}")
            assert page["cycle_length_ms"] == patient["plan"]["step0"]["cycle_length_ms"], name
            assert numbers(page["html"]) == numbers(case.section(name)), name
            assert len(page["attempts"]) >= sum(1 for _ in simulations(patient)), name
        found = dashboard.json("/api/compare/0")
        for other in flatten(found):
            if "relative_difference" in other and other["relative_difference"] is not None:
                assert other["relative_difference"] == 0, other


def numbers(text):
    """All cells of tables with their words, without the classes that a page's place gives them."""
    return [text_of(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", text, re.DOTALL)]


def flatten(value):
    if isinstance(value, dict):
        yield value
        for inner in value.values():
            yield from flatten(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from flatten(inner)


def test_the_reports_sentences(case):
    """Differences of peak pressure and stroke volume in words, and the costs beside them."""
    for name, patient in case.shown.items():
        words = re.search(r'<p class="summary">(.*?)</p>', case.section(name), re.DOTALL)[1]
        words, real = text_of(words), measured(patient)
        told = re.findall(r"Pmax ([-+.\d]+) %(?:, SV ([-+.\d]+) %)?", words)
        steps = beats(patient)
        assert len(told) == len(steps), (name, words)
        for (pressure, stroke), record in zip(told, steps.values(), strict=True):
            own = recomputed_beat(patient, record)
            for text, key in ((pressure, "P_max_mmHg"), (stroke, "SV_mL")):
                if text:
                    assert float(text) == pytest.approx(100 * (own[key] / real[key] - 1), abs=0.06), (name, key, words)
        cost = sum(x * x for x in mine.differences(real, recomputed_beat(patient, steps["step1"])).values())
        assert float(re.search(r"cost ([.\d]+)", words)[1]) == pytest.approx(cost, rel=1e-2), (name, words)


def check_shown(text, value, digits, where, slack=1e-3):
    if value is None:
        assert text in ("", "–"), where
    else:
        assert float(text) == pytest.approx(value, rel=2e-4, abs=0.5001 * 10**-digits + slack * 10**-digits * 10), where


MOTION = (
    "base_descent_mm",
    "apex_rise_mm",
    "epicardial_radius_change_percent",
    "shortening_percent",
    "wall_thickening_percent",
    "twist_epi_deg",
    "twist_endo_deg",
    "isovolumic_lengthening_percent",
    "isovolumic_untwisting_percent",
    "least_pressure_mmHg",
    "least_volume_ratio",
    "largest_volume_ratio",
)


def test_the_reports_mean_errors(case):
    section = case.report[case.report.index('id="errors"') :]
    told = table(section, "Mean ± SD of the errors, %")
    for short, row in zip(TABLE_2, told, strict=False):
        for step, column in (("step1", 1), ("step2", 5), ("step3", 7)):
            numbers = []
            for patient in case.shown.values():
                beat, real = beats(patient).get(step), measured(patient).get(TABLE_2[short])
                if beat and real:
                    numbers.append(100 * abs(recomputed_beat(patient, beat)[TABLE_2[short]] / real - 1))
            if numbers and column < len(row):
                mean, _, sd = text_of(row[column]).replace("✓", "").replace("▲", "").partition("±")
                assert float(mean) == pytest.approx(np.mean(numbers), abs=0.08), (short, step)
                if len(numbers) > 1:
                    assert float(sd) == pytest.approx(np.std(numbers, ddof=1), abs=0.08), (short, step)


def test_counts_of_patients_in_words(case):
    verified = [patient for patient in case.shown.values() if patient.get("verification")]
    good = sum(patient["verdict"]["personalised"] for patient in verified)
    crate = next(case.exported.glob("**/ro-crate-metadata.json")).read_text(encoding="utf-8")
    words = f"{len(verified)} of {len(case.shown)} patients verified in the organ, {good} of these personalised"
    assert words in crate
    assert f"verified in the organ for {len(verified)}, and {good} of these are personalised" in case.report


def test_exported_traces_are_those_of_the_beats(case):
    told = {}
    with open(case.exported / "traces.csv", encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            key = (row["patient"], row["source"], row["signal"])
            told.setdefault(key, []).append((float(row["time_ms"]), float(row["value"])))
    for name, patient in case.shown.items():
        for step, record in beats(patient).items():
            traces = mine.columns(directory(record) / "traces.csv")
            for signal, column in (
                ("pressure", "pressure_mmHg"),
                ("volume", "volume_mL"),
                ("aortic_flow", "aortic_flow_mL_per_s"),
            ):
                if (name, step, signal) in told:
                    t, values = np.array(told[name, step, signal]).T
                    assert np.allclose(values, np.interp(t, traces["time_ms"], traces[column]), rtol=1e-6, atol=1e-6)
        for file, signal in (("pressure.csv", "pressure"), ("volume.csv", "volume")):
            path = case.folder / "patients" / name / file
            if path.is_file():
                columns = mine.columns(path)
                t, values = np.array(told[name, "measured", signal]).T
                own = list(columns.values())
                assert np.allclose(values, np.interp(t, own[0], own[1]), atol=1e-6), (name, file)
