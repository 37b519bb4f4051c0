"""Cohorts for the second opinion: how they are made, and what the program says about them."""

import json
import os
import re
import shutil
import subprocess
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import recomputed as mine

ROOT = Path(__file__).parents[2]
TOLERANCES = {"P_max": 5.0, "dPdt_max": 15.0, "dPdt_min": 15.0, "PTD90": 3.0, "SV": 5.0}
TABLE_2 = {
    "P_max": "P_max_mmHg",
    "dPdt_max": "dPdt_max_mmHg_per_ms",
    "dPdt_min": "dPdt_min_mmHg_per_ms",
    "PTD90": "PTD90_ms",
    "SV": "SV_mL",
}
BIOMARKERS = (*TABLE_2.values(), "tau_VD_ms", "tau_VR_ms", "EDV_mL", "ESV_mL", "EDP_mmHg", "end_of_beat_gap_mL")
QUICK, LONG = ["quick"], ["whole", "own-mesh", "both-ventricles", "failing"]
SMALL = ("--set", "solver.time_step_ms=2", "--set", "step1.max_iterations=1", "--vtu-every", "2")
# Forty draws are the fewest.
DRAWS, NO_DRAWS = ("--set", "posterior.draws=40"), ("--set", "posterior.enabled=false")


def kinds():
    if os.environ.get("CARDIOTWIN_RUN"):
        return ["given"]
    return QUICK + (LONG if os.environ.get("CARDIOTWIN_OPINION") == "all" else [])


def program():
    named = os.environ.get("CARDIOTWIN") or shutil.which("cardiotwin")
    if not named:
        pytest.skip("no cardiotwin: name it in CARDIOTWIN")
    return str(Path(named).resolve())


def call(*arguments, accept=(0,)):
    done = subprocess.run([program(), *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode in accept, (arguments, done.returncode, done.stderr)
    return done.stdout


class Case:
    """A cohort that has run, and what the program says about it."""

    def __init__(self, kind, folder):
        self.kind, self.folder = kind, folder
        names = sorted(path.name for path in (folder / "patients").iterdir() if (path / "patient.toml").is_file())
        self.shown = {name: json.loads(call("show", name, "--cohort", folder, "--json")) for name in names}
        self.exported = folder / "exported"
        call("export", folder, "--out", self.exported, "--opencarp", "--ro-crate")
        call("report", folder, accept=(0, 7))
        self.report = (folder / "run/report.html").read_text(encoding="utf-8")
        self.tables = {
            name: json.loads((self.exported / f"{name}.json").read_text(encoding="utf-8"))
            for name in ("table_1", "table_2", "table_A6", "table_A7")
        }

    def mesh(self, name):
        """The patient's mesh, of the export for openCARP; none for a reduced ventricle."""
        folder = self.exported / "opencarp" / name
        return mine.Mesh(folder) if (folder / "heart.pts").is_file() else None

    def section(self, name):
        """The patient's part of the report."""
        begin = self.report.index(f'id="{name}"')
        end = self.report.find("<section", begin)
        return self.report[begin : end if end > 0 else None]


def cohort(kind, folder):
    """Makes and runs a cohort of a kind."""
    call("init", folder)
    shutil.rmtree(folder / "patients")
    (folder / "patients").mkdir()

    def bundled(*names):
        for name in names:
            shutil.copytree(ROOT / "examples/coa-seven/patients" / name, folder / "patients" / name)

    def run(*options, accept=(0, 7)):
        # 7: done, but a twin is off
        told = call("run", folder, "--no-report", *options, accept=accept)
        (folder / "told.txt").write_text(told, encoding="utf-8")

    def settings(name, text):
        file = folder / "patients" / name / "patient.toml"
        file.write_text(file.read_text(encoding="utf-8") + f"\n[settings]\n{text}\n", encoding="utf-8")

    if kind == "quick":
        # One is reduced and has a posterior, one is on a mesh and has step 2's fit in the organ.
        bundled("01-CoA", "05-CoA")
        settings("01-CoA", 'solver = { fidelity = "reduced" }\nstep3 = { max_iterations = 1 }')
        settings("05-CoA", "posterior = { enabled = false }\nstep3 = { max_iterations = 0 }")
        run("--mesh-nodes", "500", *SMALL, *DRAWS)
    elif kind == "whole":
        bundled("01-CoA")
        run("--mesh-nodes", "500", *SMALL, *DRAWS)
    elif kind == "own-mesh":
        bundled("02-CoA")
        run("--mesh-nodes", "500", *SMALL, "--set", "verification.enabled=false")
        call("export", folder, "--opencarp", "--out", folder / "generated")
        heart = folder / "generated/opencarp/02-CoA"
        patient = folder / "patients/02-CoA"
        for file in [*heart.glob("heart.*"), heart / "activation.dat"]:
            if file.name != "heart.unloaded.pts":
                shutil.copy(file, patient)
        with open(patient / "patient.toml", "a", encoding="utf-8") as text:
            text.write('\n[anatomy.mesh]\nfile = "heart"\nunit = "um"\nleft_ventricle = [1]\nfibres = "mesh"\n')
            text.write('activation_times_ms = "activation.dat"\n')
        shutil.rmtree(folder / "run")
        run(*SMALL, *NO_DRAWS, "--set", "step3.max_iterations=0")
    elif kind == "both-ventricles":
        patient = folder / "patients/BIV"
        patient.mkdir()
        shutil.copy(ROOT / "examples/coa-seven/patients/01-CoA/pressure.csv", patient)
        for file in (ROOT / "examples/meshes/ambit_biv").glob("ambit_biv.*"):
            shutil.copy(file, patient)
        page = (ROOT / "docs/own-anatomy.md").read_text(encoding="utf-8")
        text = re.search(r"cat > anatomy/patients/BIV/patient.toml <<'END'\n(.*?)\nEND\n", page, re.DOTALL)[1]
        (patient / "patient.toml").write_text(text, encoding="utf-8")
        run(*SMALL, *NO_DRAWS, "--set", "step3.max_iterations=0")
    elif kind == "failing":
        shutil.rmtree(folder)
        shutil.copytree(ROOT / "examples/early-end", folder)
        # 1: the verification beat fails, too
        run(*NO_DRAWS, "--set", "step3.max_iterations=0", accept=(1,))
    return folder


def worker():
    """The worker beside the program; a wheel has both as scripts."""
    beside = Path(program()).parent / "cardiotwin-worker"
    return str(beside) if beside.is_file() else shutil.which("cardiotwin-worker")


def simulated(beat, folder, parameters=None, beats=None, change=None, law=None):
    """Traces of an organ beat's specification with other parameters of the cell and of the valves, number of beats
    or load; in the organ's law that a file of samples teaches, where there is one. None without a beat."""
    beat = json.loads(json.dumps(beat))
    for key, value in (parameters or {}).items():
        place = beat["valves"] if key in beat["valves"] else beat["contraction"]["parameters"]
        place[key] = value
    for key, factor in (change or {}).items():
        beat["circulation"]["afterload"][key] *= factor
    beat["beats"] = beats or beat["beats"]
    folder.mkdir(parents=True, exist_ok=True)
    spec = folder / "task.json"
    spec.write_text(json.dumps({"kind": "organ-beat", **beat}), encoding="utf-8")
    options = ["--law", str(law)] if law else []
    command = [worker(), "simulate", str(spec), "--out", str(folder), *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    if json.loads(done.stdout)["ending"]["ending"] != "succeeded":
        return None
    return mine.columns(folder / "traces.csv")


def simulations_of(beat, sets, folder, **how):
    """The same of many sets of parameters, some at a time."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(lambda k: simulated(beat, folder / str(k), sets[k], **how), range(len(sets))))


def law_file(spec, folder):
    """The samples that teach a posterior the organ's law, as a file; none of a reduced ventricle."""
    if not spec.get("law"):
        return None
    folder.mkdir(parents=True, exist_ok=True)
    known = {"beats": spec["law"]} | ({"prior": spec["prior"]} if spec.get("prior") else {})
    (folder / "law.json").write_text(json.dumps(known), encoding="utf-8")
    return folder / "law.json"


class Dashboard:
    """A dashboard that serves a cohort until it is closed."""

    def __init__(self, folder, *options):
        command = [program(), "dashboard", str(folder), *map(str, options)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        first = self.process.stdout.readline().strip()
        assert "/?token=" in first, first
        self.address = first.partition("/?token=")[0]
        # The first address sets the token as a cookie, with which every other one answers.
        cookies = urllib.request.HTTPCookieProcessor()
        self.opener = urllib.request.build_opener(urllib.request.ProxyHandler({}), cookies)
        self.opener.open(first, timeout=60).close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(timeout=60)
        self.process.stdout.close()

    def json(self, path):
        with self.opener.open(self.address + path, timeout=120) as answer:
            return json.load(answer)

    def state(self):
        """The first message of the stream of updates, which has all rows."""
        with self.opener.open(self.address + "/api/live", timeout=60) as stream:
            for line in stream:
                if line.startswith(b"data:"):
                    return json.loads(line[5:])
        raise AssertionError("no message")


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


def beats(patient):
    """The beat that represents each step in tables."""
    found = {}
    if patient.get("step1"):
        number = patient["step1"]["best_iteration"]
        found["step1"] = next(i["run"] for i in patient["iterations"] if i["number"] == number)
    if patient.get("verification"):
        found["step2"] = patient["verification"]
    if patient.get("step3"):
        best = patient["step3"]["best_iteration"]
        found["step3"] = patient["step3_iterations"][best - 1]["run"] if best else patient["verification"]
    return {step: beat for step, beat in found.items() if beat}


def directory(record):
    return Path(record["directory"])


def recomputed_beat(patient, record):
    """Biomarkers and times of a simulated beat, from its traces."""
    traces = mine.columns(directory(record) / "traces.csv")
    t = traces["time_ms"]
    edv = measured(patient).get("EDV_mL")
    return mine.biomarkers((t, traces["pressure_mmHg"]), (t, traces["volume_mL"]), edv)


def measured(patient):
    return {key: value for key, value in patient["step0"]["result"]["measured"].items() if value is not None}


def same(told, own, where, rel=1e-4, low=1e-4):
    """Files have nine digits, so rates of pressure have some five."""
    assert told == pytest.approx(own, rel=rel, abs=low), where
