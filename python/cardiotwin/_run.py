"""Cohorts, their runs, and the results of patients. Everything is read when it is asked for."""

from __future__ import annotations

import functools
import html
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from cardiotwin._errors import StoreError, from_exit
from cardiotwin._models import Ventricle
from cardiotwin._program import call, call_json, command

if TYPE_CHECKING:
    import polars
    import pyvista
    import xarray

Setting = str | float | int | bool
Folder = str | os.PathLike[str]


class Cohort:
    """A folder with ``cohort.toml``."""

    def __init__(self, folder: Folder) -> None:
        self.folder = Path(folder)

    @classmethod
    def init(cls, folder: Folder) -> Cohort:
        """A new folder with a commented ``cohort.toml`` and one patient to fill in."""
        call("init", folder)
        return cls(folder)

    def check(self) -> dict[str, Any]:
        """Every problem of cohort, patients, settings and measured data."""
        return call_json("check", self.folder, "--json", accept=(0, 1, 3))

    def run(
        self,
        *,
        fidelity: str | None = None,
        patients: Sequence[str] = (),
        settings: Mapping[str, Setting] | None = None,
        workers: int | None = None,
        run_dir: Folder | None = None,
        progress: bool = False,
        report: bool = True,
        yes: bool = False,
    ) -> Run:
        """Personalises the cohort and returns its results; the same call goes on where an earlier one
        was stopped. ``settings`` are those of ``--set``, ``yes`` redoes finished work where settings changed.

        Patients that failed are no error of the run: their state says so. Raises a subclass of
        `cardiotwin.Error` where nothing was run.
        """
        arguments: list[str | os.PathLike[str] | float | int] = ["run", self.folder]
        if fidelity is not None:
            arguments += ["--fidelity", fidelity]
        for patient in patients:
            arguments += ["--patient", patient]
        for key, value in (settings or {}).items():
            arguments += ["--set", f"{key}={json.dumps(value) if isinstance(value, bool) else value}"]
        if workers is not None:
            arguments += ["--workers", workers]
        if run_dir is not None:
            arguments += ["--run-dir", run_dir]
        if not report:
            arguments.append("--no-report")
        if yes:
            arguments.append("--yes")
        run = Run(self.folder, run_dir)
        _follow(arguments, run, progress)
        return run

    @property
    def result(self) -> Run:
        """The run in the cohort's folder, as it is."""
        return Run(self.folder)

    def __repr__(self) -> str:
        return f"<cardiotwin.Cohort {self.folder}>"


class Run:
    """Results of a cohort so far."""

    def __init__(self, cohort: Folder, run_dir: Folder | None = None) -> None:
        self.cohort = Path(cohort)
        self.run_dir = Path(run_dir) if run_dir is not None else None

    @property
    def _place(self) -> list[Folder]:
        place: list[Folder] = [self.cohort]
        return place if self.run_dir is None else [*place, "--run-dir", self.run_dir]

    @property
    def status(self) -> dict[str, Any]:
        """Where the run and each patient stand now."""
        return call_json("status", *self._place, "--json")

    @property
    def table(self) -> pd.DataFrame:
        """A row for each patient, failures first."""
        return pd.DataFrame(self.status["patients"]).set_index("patient")

    @property
    def patients(self) -> Patients:
        """Results by patient."""
        return Patients(self)

    def report(self, out: Folder | None = None) -> Path:
        """Writes the report, one HTML file that needs no network, and returns its path."""
        arguments = ["report", *self._place, *(["--out", out] if out is not None else [])]
        return Path(call(*arguments).strip())

    def export(self, out: Folder, *options: str) -> list[Path]:
        """Writes tables and traces into a folder and returns the files; ``options`` are those of
        ``cardiotwin export``, such as ``--opencarp``."""
        answer = call_json("export", *self._place, "--out", out, "--json", *options, accept=(0, 1))
        return [Path(file) for file in answer["files"]]

    def _repr_html_(self) -> str:
        return _status_html(self.status)

    def __repr__(self) -> str:
        return f"<cardiotwin.Run of {self.cohort}>"


class Patients(Mapping[str, "Patient"]):
    """Results by the patient's name."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._names = sorted(patient["patient"] for patient in run.status["patients"])

    def __getitem__(self, name: str) -> Patient:
        if name not in self._names:
            raise KeyError(f"{name}: the run has {', '.join(self._names)}")
        return Patient(self._run, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class Patient:
    """Results of one patient, read once when they are first asked for; `refresh` forgets them."""

    def __init__(self, run: Run, name: str) -> None:
        self.run = run
        self.name = name

    @property
    def _place(self) -> list[Folder]:
        place: list[Folder] = ["--cohort", self.run.cohort]
        return place if self.run.run_dir is None else [*place, "--run-dir", self.run.run_dir]

    @functools.cached_property
    def _tables(self) -> dict[str, Any]:
        return call_json("show", self.name, *self._place, "--tables")

    @functools.cached_property
    def record(self) -> dict[str, Any]:
        """All about the patient, with provenance (``cardiotwin show --json``)."""
        return call_json("show", self.name, *self._place, "--json")

    def refresh(self) -> Patient:
        """The same patient as the run has it now."""
        return Patient(self.run, self.name)

    @property
    def status(self) -> dict[str, Any]:
        """Step, state and note."""
        status: dict[str, Any] = self._tables["status"]
        return status

    @property
    def biomarkers(self) -> pd.DataFrame:
        """Measured and simulated biomarkers: a row for each, with its unit; a column for each step."""
        return pd.DataFrame(self._tables["biomarkers"]).set_index("biomarker")

    @property
    def parameters(self) -> pd.DataFrame:
        """Personalised parameters: a row for each step and parameter, with its unit."""
        rows = pd.DataFrame(self._tables["parameters"], columns=["step", "parameter", "unit", "value"])
        return rows.set_index(["step", "parameter"])

    @property
    def posterior(self) -> pd.DataFrame:
        """Quantiles of each parameter after and before the measurements; empty before it was sampled."""
        columns = ["parameter", "unit", "twin", "p5", "p50", "p95", "prior_p5", "prior_p50", "prior_p95", "mark"]
        return pd.DataFrame(self._tables["posterior"], columns=columns).set_index("parameter")

    @property
    def draws(self) -> pd.DataFrame:
        """Draws of the posterior: a row for each draw, a column for each parameter."""
        return pd.DataFrame(self._tables["draws"], columns=list(self.posterior.index))

    @property
    def traces(self) -> pd.DataFrame:
        """All traces, one value a row: source, signal, unit, time_ms, value."""
        parts = [pd.DataFrame(trace) for trace in self._tables["traces"]]
        columns = ["source", "signal", "unit", "time_ms", "value"]
        return pd.concat(parts, ignore_index=True)[columns] if parts else pd.DataFrame(columns=columns)

    @property
    def traces_polars(self) -> polars.DataFrame:
        """`traces` for polars (extra ``polars``)."""
        import polars

        return polars.DataFrame(self.traces.to_dict("list"))

    @property
    def traces_xarray(self) -> dict[str, xarray.Dataset]:
        """Traces by source, each signal over its times as an array with its unit (extra ``xarray``)."""
        import xarray

        sets: dict[str, dict[str, xarray.DataArray]] = {}
        for trace in self._tables["traces"]:
            time_name = f"time_ms_{trace['signal']}"
            array = xarray.DataArray(
                trace["value"],
                dims=[time_name],
                coords={time_name: trace["time_ms"]},
                attrs={"units": trace["unit"]},
            )
            sets.setdefault(trace["source"], {})[trace["signal"]] = array
        return {source: xarray.Dataset(arrays) for source, arrays in sets.items()}

    @property
    def ventricle(self) -> Ventricle:
        """The twin's beat for this process: of a 3D run the one-fibre ventricle of the same volumes,
        pressure and activation."""
        beat = self._tables["beat"]
        if beat is None:
            raise StoreError(f"{self.name}: step 0 is not done; run the cohort first")
        return Ventricle(beat)

    @property
    def mesh(self) -> pyvista.MultiBlock:
        """The twin's 3D wall for PyVista (extra ``pyvista``): the half behind a plane through the long
        axis, a block for each of end-diastole and end-systole, with stress and stretch."""
        file = self._tables["heart"]
        if file is None:
            raise StoreError(f"{self.name}: the run has no 3D beat; run with fidelity='finite-element'")
        from cardiotwin._mesh import heart

        return heart(Path(file))

    @property
    def series(self) -> pyvista.PVDReader:
        """The twin's series of the whole mesh over the beat, where the run wrote one
        (``settings={"executor.vtu_every_ms": 10}``), as PyVista's reader."""
        file = self._tables["series"]
        if file is None:
            raise StoreError(f"{self.name}: the run wrote no series; set executor.vtu_every_ms in a 3D run")
        import pyvista

        return pyvista.PVDReader(file)

    def _repr_html_(self) -> str:
        page = call("show", self.name, *self._place, "--html")
        return f'<iframe srcdoc="{html.escape(page)}" width="100%" height="640" style="border:0"></iframe>'

    def __repr__(self) -> str:
        return f"<cardiotwin.Patient {self.name}: {self.status['step']} {self.status['state']}>"


def _follow(arguments: Sequence[Any], run: Run, progress: bool) -> None:
    """Runs the program and shows the run's table while it works. Ctrl-C stops it as in a terminal."""
    display = _display(run) if progress else None
    with tempfile.TemporaryFile("w+", encoding="utf-8") as words:
        started = subprocess.Popen(
            command(arguments), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=words
        )
        try:
            while started.poll() is None:
                time.sleep(0.2 if display is None else 1.0)
                if display is not None and started.poll() is None:
                    display()
        except KeyboardInterrupt:
            started.terminate()
            started.wait()
            raise
        words.seek(0)
        text = words.read()
    if started.returncode not in (0, 1, 7):  # 7: done, but a twin is off
        raise from_exit(started.returncode, text)
    if display is not None:
        display()


def _display(run: Run) -> Any:
    """A function that shows the run's table anew: in Jupyter in place, elsewhere as lines on stderr."""
    shell = sys.modules.get("IPython")
    kernel = shell is not None and getattr(shell.get_ipython(), "kernel", None) is not None
    seen: dict[str, tuple[str, str]] = {}
    handle: list[Any] = []

    def show() -> None:
        try:
            status = run.status
        except StoreError:
            return  # The database comes with the first commit.
        if kernel:
            ipython: Any = importlib.import_module("IPython.display")
            table = ipython.HTML(_status_html(status))
            if handle:
                handle[0].update(table)
            else:
                handle.append(ipython.display(table, display_id=True))
            return
        for patient in status["patients"]:
            now = (patient["step"], patient["state"])
            if seen.get(patient["patient"]) != now:
                seen[patient["patient"]] = now
                words = dict.fromkeys((patient["patient"], *now, patient["note"]))  # "done" once
                print("  ".join(filter(None, words)), file=sys.stderr)

    return show


def _status_html(status: Mapping[str, Any]) -> str:
    columns = {
        "patient": "patient",
        "step": "step",
        "state": "state",
        "step1_cost": "cost of step 1",
        "step2_cost": "cost of step 2",
        "note": "note",
    }

    def cell(value: object) -> str:
        text = "" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)
        return f"<td>{html.escape(text)}</td>"

    head = "".join(f"<th>{name}</th>" for name in columns.values())
    rows = "".join(f"<tr>{''.join(cell(p.get(key)) for key in columns)}</tr>" for p in status["patients"])
    counts = ", ".join(f"{n} {state}" for state, n in status["counts"].items() if n)
    caption = html.escape(f"{status['cohort']}: {counts}")
    return f"<table><caption>{caption}</caption><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
