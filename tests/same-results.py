#!/usr/bin/env python3
"""Do two builds of cardiotwin compute the same numbers, to the bit?

    tests/same-results.py OLD NEW [--out DIR] [--only NAME,NAME] [--full]

OLD and NEW are folders that hold `cardiotwin` and `cardiotwin-worker`. Both builds run the same commands on the bundled
examples: the seven patients with the reduced ventricle, one of them in 3D, every effect of the heart in the catalogue, a hidden effect,
sweeps, recordings, a measured afterload. Then every JSON and CSV file that the two builds wrote is compared number by
number. Moments, durations, versions and paths are left out.

`--full` runs all seven patients in 3D with the default mesh, too (minutes). Exit code: 0 the same, 1 different, 2 a
command failed. A change that is meant to move results states the printed sizes in its commit.
"""

import argparse
import csv
import json
import math
import os
import pathlib
import shutil
import subprocess
import sys

EXAMPLES = pathlib.Path(__file__).resolve().parent.parent / "examples"
SEVEN = EXAMPLES / "coa-seven"
# Physiological effects with their typical strength (docs/effects/README.md); artefacts are refused
# in a model.
EFFECTS = {
    "aortic_regurgitation": ("orifice_cm2", 0.05),
    "aortic_stenosis": ("loss_mmHg_s2_per_mL2", 2e-5),
    "atrial_kick": ("amplitude_mmHg", 8.0),
    "cross_fibre_stress": ("cross_fibre_share", 0.1),
    "delayed_relaxation": ("tau_ms", 20.0),
    "dyssynchrony": ("delay_ms", 20.0),
    "mitral_regurgitation": ("orifice_cm2", 0.05),
    "passive_stiffening": ("exponent_factor", 1.5),
    "pericardial_constraint": ("pressure_mmHg", 2.0),
    "ventricular_septal_defect": ("orifice_cm2", 0.04),
    "viscoelasticity": ("viscosity_mmHg_s_per_mL", 0.003),
    "wave_reflection": ("inertance_mmHg_s2_per_mL", 0.003),
}
# Keys of JSON and columns of CSV with times, places, durations and builds.
VOLATILE = {
    "commit", "created", "cpu_s", "directory", "elapsed_s", "ended", "ended_at", "finished_at", "folder", "host", "made",
    "path", "pid", "profile", "program", "provenance", "run", "run_dir", "seconds", "started", "started_at", "time",
    "version", "versions", "wall_s", "worker", "worker_commit", "made_at", "written_at", "at", "rustc", "cores",
    "time_per_evaluation_step2_s", "time_per_iteration_step1_s",
}


def commands(out, full):
    """Names and arguments of the commands; each writes into `out`/name."""
    seven = str(SEVEN)
    brief = ["--no-report", "--set", "posterior.enabled=false"]
    yield "reduced", ["run", seven, "--run-dir", out / "reduced", "--fidelity", "reduced", *brief]
    yield "posterior", ["run", seven, "--run-dir", out / "posterior", "--patient", "01-CoA", "--fidelity", "reduced", "--no-report",
                        "--set", "posterior.draws=40"]
    yield "reduced-export", ["export", seven, "--run-dir", out / "reduced", "--out", out / "reduced-export"]
    yield "predict", ["predict", "03-CoA", "--cohort", seven, "--run-dir", out / "reduced", "--json",
                      "--set", "peripheral_resistance_mmHg_s_per_mL=-20%"]
    yield "in-3d", ["run", seven, "--run-dir", out / "in-3d", "--patient", "03-CoA", "--mesh-nodes", "500", *brief]
    yield "in-3d-export", ["export", seven, "--run-dir", out / "in-3d", "--out", out / "in-3d-export"]
    yield "hidden-effect", ["discover", EXAMPLES / "hidden-effect", "--run-dir", out / "hidden-effect"]
    yield "gsa", ["sweep", "gsa", "--out", out / "gsa", "--samples", "16", "--resamples", "20"]
    yield "robustness", ["sweep", "robustness", seven, "--kind", "data", "--patient", "03-CoA", "--samples", "2",
                         "--out", out / "robustness", "--set", "solver.fidelity=reduced"]
    yield "recordings", ["prepare", EXAMPLES / "recordings/P001-raw", out / "recordings/P001", "--json"]
    record = EXAMPLES / "afterload/human-1999"
    yield "afterload", ["fit", "afterload", record / "flow.csv", record / "pressure.csv", "--json"]
    yield "afterload-effects", ["discover", "--afterload", record / "flow.csv", record / "pressure.csv", "--json"]
    yield "calcium", ["fit", "calcium", EXAMPLES / "calcium/transient.csv", "--json"]
    if full:
        yield "seven-in-3d", ["run", seven, "--run-dir", out / "seven-in-3d", "--no-report"]


def effect_cohort(out):
    """The bundled patient 03-CoA with one effect of the catalogue each, as patients of a cohort of its own."""
    cohort = out / "effects-cohort"
    shutil.copytree(SEVEN / "patients/03-CoA", cohort / "patients/none")
    for effect in EFFECTS:
        shutil.copytree(SEVEN / "patients/03-CoA", cohort / "patients" / effect)
    for folder in sorted((cohort / "patients").iterdir()):
        patient = folder / "patient.toml"
        text = patient.read_text().replace('"03-CoA"', f'"{folder.name}"')
        if folder.name in EFFECTS:
            parameter, strength = EFFECTS[folder.name]
            head = f'version = 1\npatient = "{folder.name}"\nwritten = "2026-01-01T00:00:00Z"\n[from]\nhand = "typical strength"\n'
            effect = f'[[effects]]\nname = "{folder.name}"\n[effects.parameters]\n{parameter} = {strength}\n'
            (folder / "model.toml").write_text(head + effect)
        patient.write_text(text)
    (cohort / "cohort.toml").write_text('name = "effects"\n')
    return cohort


def run(programs, out, name, arguments):
    out.mkdir(parents=True, exist_ok=True)
    called = [programs / "cardiotwin", *arguments]
    with open(out / f"{name}.stdout.json", "wb") as answer:
        ended = subprocess.run([str(a) for a in called], stdout=answer, stderr=subprocess.PIPE, check=False)
    # Exit code 1 means that a patient failed or that a check has a negative result; the files are
    # compared all the same.
    if ended.returncode not in (0, 1):
        sys.stderr.write(ended.stderr.decode(errors="replace"))
        print(f"same-results: `{' '.join(map(str, called))}` ended with {ended.returncode}", file=sys.stderr)
        sys.exit(2)


def numbers(file):
    """Leaves of a file with their places, volatile ones left out."""
    def leaves(value, place):
        if isinstance(value, dict):
            for key in value:
                if key not in VOLATILE:
                    yield from leaves(value[key], f"{place}.{key}")
        elif isinstance(value, list):
            for idx, item in enumerate(value):
                yield from leaves(item, f"{place}[{idx}]")
        else:
            yield place, value

    text = file.read_text()
    if file.suffix == ".csv":
        with open(file, newline="") as lines:
            rows = list(csv.reader(lines))
        head = rows[0] if rows else []
        kept = [idx for idx, name in enumerate(head) if name not in VOLATILE]
        for line, row in enumerate(rows):
            for idx in kept:
                yield f"line {line + 1}, {head[idx]}", row[idx] if idx < len(row) else None
        return
    try:
        yield from leaves(json.loads(text), "")
    except json.JSONDecodeError:
        # A table for people, with durations and paths; its numbers are also in the files.
        return


def difference(a, b):
    """Relative difference of two leaves: 0 where they are the same to the bit, infinite where no numbers."""
    if a == b or (isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b)):
        return 0.0
    try:
        a, b = float(a), float(b)
    except (TypeError, ValueError):
        return math.inf
    scale = max(abs(a), abs(b))
    return abs(a - b) / scale if scale else 0.0


def kept_files(folder):
    for file in sorted(folder.rglob("*")):
        parts = file.relative_to(folder).parts
        if file.is_file() and file.suffix in (".csv", ".json") and not {"checkpoint", "scratch", "report"} & set(parts):
            if file.name not in ("started.json", "lease.json", "run.json"):
                yield file.relative_to(folder)


def compare(old, new):
    """Counts of compared leaves, and the differences by file."""
    ours, theirs = set(kept_files(old)), set(kept_files(new))
    found, n_leaves = {}, 0
    for file in sorted(ours ^ theirs):
        found[file] = (math.inf, "only in " + ("OLD" if file in ours else "NEW"))
    for file in sorted(ours & theirs):
        a, b = dict(numbers(old / file)), dict(numbers(new / file))
        n_leaves += len(a)
        worst = max(
            ((difference(a.get(place), b.get(place)), place) for place in {**a, **b}), default=(0.0, ""), key=lambda x: x[0]
        )
        if worst[0] > 0:
            place = worst[1]
            found[file] = (worst[0], f"{place}: {a.get(place)!r} against {b.get(place)!r}")
    return len(ours & theirs), n_leaves, found


def stages(programs, out, run_dir, cohort, patient):
    """Hashes of a patient's artefacts by stage. Keys of later tasks change with the results before them, so that their
    folders cannot be compared by name."""
    called = [programs / "cardiotwin", "show", patient, "--run-dir", out / run_dir, "--cohort", cohort, "--json"]
    answer = subprocess.run([str(a) for a in called], capture_output=True, text=True, check=False)
    if answer.returncode:
        return {}
    shown = json.loads(answer.stdout)

    def hashes(run):
        return sorted((a["name"], a["sha256"]) for a in (run or {}).get("artefacts", []))

    found = {stage: hashes(shown.get(key)) for stage, key in
             {"step 0": "step0", "targets": "targets", "step 2": "cell_fit", "verification": "verification"}.items()}
    found["step 1"] = [(i["parameters"], hashes(i.get("run"))) for i in shown["iterations"]]
    found["step 3"] = [hashes(i.get("run")) for i in shown.get("step3_iterations") or []]
    return {stage: value for stage, value in found.items() if value}


def compare_stages(sides, given):
    """Prints for each run how many patients' stages are the same to the bit."""
    for run_dir, cohort in {"reduced": None, "posterior": None, "in-3d": None, "effects": "effects-cohort", "seven-in-3d": None}.items():
        same, both = {}, {}
        folder = (given.out / "new" / cohort if cohort else SEVEN) / "patients"
        for patient in sorted(f.name for f in folder.iterdir()) if (given.out / "new" / run_dir).is_dir() else []:
            old, new = (
                stages(programs, (given.out / side).resolve(), run_dir, given.out / side / cohort if cohort else SEVEN, patient)
                for side, programs in sides.items()
            )
            for stage in old.keys() & new.keys():
                both[stage] = both.get(stage, 0) + 1
                same[stage] = same.get(stage, 0) + (old[stage] == new[stage])
        words = ", ".join(f"{stage} {same[stage]} of {both[stage]}" for stage in sorted(both))
        if words:
            print(f"{run_dir}: patients with the same bits in {words}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=pathlib.Path)
    parser.add_argument("new", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("same-results"))
    parser.add_argument("--only", default="")
    parser.add_argument("--full", action="store_true")
    given = parser.parse_args()
    only = set(filter(None, given.only.split(",")))
    sides = {"old": given.old.resolve(), "new": given.new.resolve()}
    for side, programs in sides.items():
        out = (given.out / side).resolve()
        made = out / "made-by"
        build = str(os.stat(programs / "cardiotwin").st_mtime_ns)
        # Results of the same build are kept: the old build runs once for many new ones.
        if made.exists() and made.read_text() != build:
            shutil.rmtree(out)
        out.mkdir(parents=True, exist_ok=True)
        made.write_text(build)
        todo = list(commands(out, given.full))
        cohort = out / "effects-cohort"
        if not cohort.exists():
            effect_cohort(out)
        todo.append(("effects", ["run", cohort, "--run-dir", out / "effects", "--fidelity", "reduced", "--no-report",
                                 "--set", "workflow.until=step2-verification", "--set", "step1.max_iterations=1"]))
        for name, arguments in todo:
            if (not only or name in only) and not (out / f"{name}.stdout.json").exists():
                print(f"{side}: {name}", file=sys.stderr)
                run(programs, out, name, arguments)
    n_files, n_leaves, found = compare(given.out / "old", given.out / "new")
    for file, (size, words) in sorted(found.items(), key=lambda x: -x[1][0]):
        print(f"{size:9.2e}  {file}  {words}")
    compare_stages(sides, given)
    print(f"{n_files} files, {n_leaves} values compared: " + (f"{len(found)} files differ" if found else "the same to the bit"))
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
