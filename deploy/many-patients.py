"""Memory and time of the coordinator over a cohort of many patients.

The patients are those of coa-seven that converge, each with another wall volume so that no two share
a task; step 2 is cheap. Printed: peak memory and processor time of the whole run, of a run with
nothing to do, of one that reads all files again, and files and bytes of a patient.

    python3 deploy/many-patients.py --patients 1000 --program target/release/cardiotwin
"""

import argparse
import json
import os
import re
import tempfile
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parent.parent / "examples" / "coa-seven" / "patients"
COHORT = """name = "many"
description = "coa-seven repeated"
patients = "patients"
solver.fidelity = "reduced"
step2.popsize = 3
step2.max_generations = 4
step2.polish = false
verification.enabled = false
"""


def make_cohort(folder: Path, n: int) -> None:
    """Writes a cohort of n patients, of whom no two are equal."""
    models = sorted(path for path in EXAMPLE.iterdir() if path.name != "04-CoA")
    (folder / "patients").mkdir(parents=True)
    (folder / "cohort.toml").write_text(COHORT)
    for i in range(n):
        name = f"P{i:05d}"
        own = folder / "patients" / name
        own.mkdir()
        for file in models[i % len(models)].iterdir():
            text = file.read_text()
            if file.name == "patient.toml":
                text = re.sub(r"(?m)^#:schema.*\n", "", text)
                text = re.sub(r"(?m)^id = .*", f'id = "{name}"', text)
                text = re.sub(
                    r"(?m)^wall_volume_mL = ([\d.]+)",
                    lambda found, i=i: f"wall_volume_mL = {float(found[1]) + 1e-5 * i:.5f}",
                    text,
                )
            (own / file.name).write_text(text)


def measured(command: list[str]) -> dict[str, float]:
    """Runs a command and gives its peak memory [MB] and processor time without its children [s]."""
    pid = os.fork()
    if pid == 0:
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        os.execv(command[0], command)
    _, status, used = os.wait4(pid, 0)
    if os.waitstatus_to_exitcode(status) not in (0, 1, 9):
        raise SystemExit(f"{' '.join(command)} ended with {os.waitstatus_to_exitcode(status)}")
    return {"peak_mb": used.ru_maxrss / 1000, "processor_s": used.ru_utime + used.ru_stime}


def main() -> None:
    """Makes the cohort, runs it three times, and prints the figures as JSON."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--patients", type=int, default=1000)
    arguments.add_argument("--program", type=Path, required=True)
    arguments.add_argument("--folder", type=Path, help="keep cohort and run here")
    given = arguments.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = given.folder or Path(scratch)
        if not (folder / "cohort.toml").exists():
            make_cohort(folder, given.patients)
        run = [str(given.program.resolve()), "run", str(folder)]
        figures: dict[str, object] = {"patients": given.patients}
        figures["first run"] = measured(run)
        measured(run)  # notes the marks of folders that were too young at the first run
        figures["nothing to do"] = measured(run)
        figures["all files read"] = measured([*run, "--verify"])
        files = list((folder / "run" / "attempts").rglob("*"))
        figures["files and folders of attempts per patient"] = len(files) / given.patients
        figures["MB of attempts per patient"] = (
            1e-6 * sum(path.lstat().st_size for path in files) / given.patients
        )
        print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
