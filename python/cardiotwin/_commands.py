"""`simulate`, `predict`, `discover` and `sweep` as functions: the answers of the programs' ``--json``."""

from __future__ import annotations

import functools
import hashlib
import html
import json
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cardiotwin._changes import Change
from cardiotwin._errors import UsageError, without_folder
from cardiotwin._extras import needs
from cardiotwin._html import picture
from cardiotwin._measurements import Arrays, Measurements, made
from cardiotwin._models import Ventricle
from cardiotwin._names import HelpfulAttributes
from cardiotwin._prediction import Prediction
from cardiotwin._program import Argument, call, call_json
from cardiotwin._values import Traces, Values

if TYPE_CHECKING:
    import pandas as pd
    from typing_extensions import Unpack

Folder = str | os.PathLike[str]

Circulation = Literal["open", "closed"]
"""An atrium at constant pressure and a Windkessel, or a loop whose blood goes round."""


@dataclass(frozen=True)
class Simulation(HelpfulAttributes):
    """Answer of `simulate`."""

    answer: dict[str, Any]

    @functools.cached_property
    def biomarkers(self) -> Values:
        """Biomarkers of the last beat by name."""
        return Values(self.answer["result"]["biomarkers"])

    @functools.cached_property
    def traces(self) -> Traces:
        """Traces of the last beat by name."""
        return Traces(self.answer["traces"])

    @functools.cached_property
    def ventricle(self) -> Ventricle:
        """The same beat for this process."""
        return Ventricle(self.answer["specification"])

    def _repr_html_(self) -> str:
        return self.biomarkers.html()

    def __repr__(self) -> str:
        return f"a beat of {self.answer['patient']}\n{self.biomarkers!r}"


@dataclass(frozen=True)
class Discovery(HelpfulAttributes):
    """Answer of `discover` for a patient."""

    answer: dict[str, Any]
    figure: str = ""
    """Measured and simulated traces as SVG, of one patient."""

    @property
    def summary(self) -> str:
        """The finding in plain language."""
        return str(self.answer["summary"])

    def _repr_html_(self) -> str:
        figure = picture(self.figure, "measured and simulated traces") if self.figure else ""
        return f"<p>{html.escape(self.summary)}</p>{figure}"

    def __repr__(self) -> str:
        return self.summary


@dataclass(frozen=True)
class Sensitivity(HelpfulAttributes):
    """Answer of `sweep`."""

    answer: dict[str, Any]
    folder: Path
    """Folder of the sweep."""

    @functools.cached_property
    def ranking(self) -> pd.DataFrame:
        """Parameters by the sum of their total indices."""
        with needs("pandas"):
            import pandas as pd
        return pd.DataFrame(self.answer["sensitivity"]["ranking"]).set_index("name")

    @functools.cached_property
    def indices(self) -> pd.DataFrame:
        """A row for each biomarker and parameter: first-order and total index with half-widths."""
        with needs("pandas"):
            import pandas as pd
        rows: list[dict[str, Any]] = [
            {"biomarker": output["name"], "parameter": parameter["name"]}
            | _columns("S1", parameter["first"])
            | _columns("ST", parameter["total"])
            for output in self.answer["sensitivity"]["outputs"]
            for parameter in output["parameters"]
        ]
        return pd.DataFrame(rows).set_index(["biomarker", "parameter"])


def simulate(
    patient: str,
    *,
    cohort: Folder = ".",
    set: Mapping[str, Change] | None = None,
    beats: int | str | None = None,
    circulation: Circulation = "open",
    cell: bool = False,
    contraction: str | None = None,
    run_dir: Folder | None = None,
) -> Simulation:
    """One simulation of a patient's organ, outside of any run (``cardiotwin simulate``)."""
    arguments = ["simulate", patient, "--json", *_of(cohort, run_dir), *_assignments(set)]
    arguments += _options({"--beats": beats, "--circulation": circulation, "--contraction": contraction})
    arguments += ["--cell"] if cell else []
    return Simulation(call_json(*arguments, accept=(0, 1)))


def predict(
    patient: str,
    *,
    set: Mapping[str, Change],
    cohort: Folder = ".",
    beats: int | None = None,
    circulation: Circulation = "open",
    in_3d: bool = False,
    band: bool = True,
    run_dir: Folder | None = None,
) -> Prediction:
    """The effect of a treatment on a twin (``cardiotwin predict``). Values are numbers, or shares such as
    ``"-20 %"``. `Twin.predict` does the same with short names."""
    arguments = ["predict", patient, "--json", *_of(cohort, run_dir), *_assignments(set)]
    arguments += _options({"--beats": beats, "--circulation": circulation})
    arguments += ["--in-3d"] if in_3d else []
    arguments += [] if band else ["--no-band"]
    with tempfile.TemporaryDirectory(prefix="cardiotwin-") as out:
        answer = call_json(*arguments, "--out", out, accept=(0, 1))["predictions"][0]
        files = {Path(file).name.removeprefix(answer["patient"]): Path(file) for file in answer["files"]}
        before, after = (_read_traces(files[name]) for name in ("-before.csv", "-after.csv"))
        figure = files[".svg"].read_text(encoding="utf-8")
    answer["files"] = []
    return Prediction(answer, before, after, figure)


def discover(
    patient: Folder | Measurements | None = None,
    *,
    effects: Iterable[str] = (),
    seed: int | None = None,
    jobs: int | None = None,
    run_dir: Folder | None = None,
    **arrays: Unpack[Arrays],
) -> Discovery:
    """Effects that the model misses in measured traces (``cardiotwin discover``): of a patient's folder, or of
    arrays, ``discover(time_ms=t, pressure_mmHg=p, volume_mL=v, cycle_length_ms=800)``, which are the keywords
    of `Measurements` and leave no file behind."""
    options = _options({"--seed": seed, "--jobs": jobs, "--effects": ",".join(effects) or None})
    if isinstance(patient, (str, os.PathLike)):
        if arrays:
            raise UsageError("discover: give a folder or arrays, not both")
        return _discover(Path(patient), [*options, *_options({"--run-dir": run_dir})])
    if run_dir is not None:
        raise UsageError("discover: a search of arrays keeps no folder, so that it takes no run_dir")
    with tempfile.TemporaryDirectory(prefix="cardiotwin-") as place:
        folder = measured(patient, arrays).write(Path(place) / "patient")
        with without_folder(folder):
            return _discover(folder, options)


def measured(measurements: Measurements | None, arrays: Mapping[str, Any]) -> Measurements:
    """Measurements as they were given, or those of keywords."""
    if measurements is not None and arrays:
        raise UsageError("give measurements or arrays, not both")
    return made(arrays) if measurements is None else measurements


def _discover(folder: Path, options: list[Argument]) -> Discovery:
    arguments: list[Argument] = ["discover", folder, *options]
    with tempfile.TemporaryDirectory(prefix="cardiotwin-") as out:
        plot = Path(out) / "traces.svg"
        of_one = (folder / "patient.toml").is_file()
        arguments += ["--plot", plot] if of_one else []
        answer = json.loads(call(*arguments, "--json", accept=(0, 1)))
        return Discovery(answer, plot.read_text(encoding="utf-8") if plot.is_file() else "")


def sweep(
    out: Folder | None = None,
    *,
    samples: int | None = None,
    organ: str | None = None,
    cohort: Folder | None = None,
    bounds: Mapping[str, Sequence[float]] | None = None,
    set: Mapping[str, float | str] | None = None,
    seed: int | None = None,
    scramble: bool = False,
    workers: int | None = None,
) -> Sensitivity:
    """Sobol indices of the cell, or of a patient's organ (``cardiotwin sweep gsa``). The same call goes on
    where an earlier one was stopped.

    Without ``out``, each set of options has a folder of its own in ``sweeps``, so that no sweep meets
    another; the answer's ``folder`` names it. Raises `UsageError` where ``out`` holds another sweep.
    """
    arguments: list[Argument] = [*_assignments(set)]
    arguments += _options({"--samples": samples, "--organ": organ, "--cohort": cohort, "--seed": seed})
    for name, interval in (bounds or {}).items():
        lower, upper = interval
        arguments += ["--bounds", f"{name}={lower},{upper}"]
    arguments += ["--scramble"] if scramble else []
    folder = Path("sweeps") / _name_of_sweep(arguments, organ, cohort) if out is None else Path(out)
    workers_of = _options({"--workers": workers})
    answer = call_json("sweep", "gsa", "--out", folder, "--json", *arguments, *workers_of)
    return Sensitivity(answer, folder)


def _name_of_sweep(arguments: Sequence[Argument], organ: str | None, cohort: Folder | None) -> str:
    """A name that is another one for other options, and for another twin of the patient."""
    what: list[Any] = [os.fspath(a) if isinstance(a, os.PathLike) else a for a in arguments]
    if organ is not None:
        place = Path(cohort or ".")
        what += [str(place.resolve()), call_json("show", organ, "--cohort", place, "--tables")["beat"]]
    digest = hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()
    return "-".join(filter(None, ["gsa", organ, digest[:8]]))


def _columns(of: str, index: Mapping[str, float] | None) -> dict[str, Any]:
    return {f"{of}_{key}": value for key, value in (index or {}).items()}


def _read_traces(file: Path) -> Traces:
    head, *lines = file.read_text(encoding="utf-8").splitlines()
    rows = [[float(cell) if cell else float("nan") for cell in line.split(",")] for line in lines]
    return Traces(dict(zip(head.split(","), zip(*rows, strict=True), strict=True)))


def _of(cohort: Folder, run_dir: Folder | None) -> list[Argument]:
    return ["--cohort", cohort, *_options({"--run-dir": run_dir})]


def _options(options: Mapping[str, Argument | None]) -> list[Argument]:
    return [part for name, value in options.items() if value is not None for part in (name, value)]


def _assignments(values: Mapping[str, float | str] | None) -> list[Argument]:
    return [part for name, value in (values or {}).items() for part in ("--set", f"{name}={value}")]
