"""Cohorts, and their runs while they work."""

from __future__ import annotations

import importlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cardiotwin._errors import StoreError, from_exit
from cardiotwin._html import status_table
from cardiotwin._names import HelpfulAttributes
from cardiotwin._program import Argument, call, call_json, command
from cardiotwin._run import Folder, Run
from cardiotwin._settings import Setting, assignment


class Cohort(HelpfulAttributes):
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
        patients: Iterable[str] = (),
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
        arguments: list[Argument] = ["run", self.folder]
        if fidelity is not None:
            arguments += ["--fidelity", fidelity]
        for patient in [patients] if isinstance(patients, str) else patients:
            arguments += ["--patient", patient]
        for key, value in (settings or {}).items():
            arguments += ["--set", assignment(key, value)]
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
            table = ipython.HTML(status_table(status))
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
