"""`simulate`, `predict`, `discover` and `sweep` as functions: the answers of the programs' ``--json``."""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from cardiotwin._models import Ventricle
from cardiotwin._program import Argument, call, call_json

Folder = str | os.PathLike[str]


@dataclass(frozen=True)
class Simulation:
    """Answer of `simulate`."""

    answer: dict[str, Any]

    @functools.cached_property
    def biomarkers(self) -> pd.Series[float]:
        """Biomarkers of the last beat by name."""
        return pd.Series(self.answer["result"]["biomarkers"])

    @functools.cached_property
    def traces(self) -> pd.DataFrame:
        """Traces of the last beat by column."""
        return pd.DataFrame(self.answer["traces"])

    @functools.cached_property
    def ventricle(self) -> Ventricle:
        """The same beat for this process."""
        return Ventricle(self.answer["specification"])


@dataclass(frozen=True)
class Prediction:
    """Answer of `predict` for one twin."""

    answer: dict[str, Any]

    @functools.cached_property
    def table(self) -> pd.DataFrame:
        """A row for each index: the twin, the relative change, the prediction and its 90 % interval."""
        rows = pd.DataFrame(self.answer["indices"]).set_index("name")
        band = [value or (float("nan"), float("nan")) for value in rows.pop("band")]
        return rows.assign(p5=[low for low, _ in band], p95=[high for _, high in band])


@dataclass(frozen=True)
class Discovery:
    """Answer of `discover` for a patient."""

    answer: dict[str, Any]

    @property
    def summary(self) -> str:
        """The finding in plain language."""
        return str(self.answer["summary"])

    def __repr__(self) -> str:
        return self.summary


@dataclass(frozen=True)
class Sensitivity:
    """Answer of `sweep`."""

    answer: dict[str, Any]

    @functools.cached_property
    def ranking(self) -> pd.DataFrame:
        """Parameters by the sum of their total indices."""
        return pd.DataFrame(self.answer["sensitivity"]["ranking"]).set_index("name")

    @functools.cached_property
    def indices(self) -> pd.DataFrame:
        """A row for each biomarker and parameter: first-order and total index with half-widths."""
        rows = [
            {"biomarker": output["name"], "parameter": parameter["name"]}
            | {f"S1_{key}": value for key, value in (parameter["first"] or {}).items()}
            | {f"ST_{key}": value for key, value in (parameter["total"] or {}).items()}
            for output in self.answer["sensitivity"]["outputs"]
            for parameter in output["parameters"]
        ]
        return pd.DataFrame(rows).set_index(["biomarker", "parameter"])


def simulate(
    patient: str,
    *,
    cohort: Folder = ".",
    set: Mapping[str, float | str] | None = None,
    beats: int | str | None = None,
    cell: bool = False,
    contraction: str | None = None,
    run_dir: Folder | None = None,
) -> Simulation:
    """One simulation of a patient's organ, outside of any run (``cardiotwin simulate``)."""
    arguments = ["simulate", patient, "--json", *_of(cohort, run_dir), *_assignments(set)]
    arguments += _options({"--beats": beats, "--contraction": contraction})
    arguments += ["--cell"] if cell else []
    return Simulation(call_json(*arguments, accept=(0, 1)))


def predict(
    patient: str,
    *,
    set: Mapping[str, float | str],
    cohort: Folder = ".",
    beats: int | None = None,
    in_3d: bool = False,
    band: bool = True,
    run_dir: Folder | None = None,
) -> Prediction:
    """The effect of a treatment on a twin (``cardiotwin predict``). Values are numbers, or shares such as
    ``"-20%"``."""
    arguments = ["predict", patient, "--json", *_of(cohort, run_dir), *_assignments(set)]
    arguments += _options({"--beats": beats})
    arguments += ["--in-3d"] if in_3d else []
    arguments += [] if band else ["--no-band"]
    return Prediction(call_json(*arguments, accept=(0, 1))["predictions"][0])


def discover(
    folder: Folder,
    *,
    effects: Iterable[str] = (),
    seed: int | None = None,
    jobs: int | None = None,
    run_dir: Folder | None = None,
) -> Discovery:
    """Effects that the model misses in the traces of a patient's folder (``cardiotwin discover``)."""
    arguments: list[Argument] = ["discover", folder]
    arguments += _options(
        {"--seed": seed, "--jobs": jobs, "--run-dir": run_dir, "--effects": ",".join(effects) or None}
    )
    return Discovery(json.loads(call(*arguments, "--json", accept=(0, 1))))


def sweep(
    out: Folder,
    *,
    samples: int | None = None,
    organ: str | None = None,
    cohort: Folder | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    set: Mapping[str, float | str] | None = None,
    seed: int | None = None,
    scramble: bool = False,
    workers: int | None = None,
) -> Sensitivity:
    """Sobol indices of the cell, or of a patient's organ (``cardiotwin sweep gsa``). The same call goes on
    where an earlier one was stopped."""
    arguments: list[Argument] = ["sweep", "gsa", "--out", Path(out), "--json", *_assignments(set)]
    arguments += _options(
        {"--samples": samples, "--organ": organ, "--cohort": cohort, "--seed": seed, "--workers": workers}
    )
    for name, (lower, upper) in (bounds or {}).items():
        arguments += ["--bounds", f"{name}={lower},{upper}"]
    arguments += ["--scramble"] if scramble else []
    return Sensitivity(call_json(*arguments))


def _of(cohort: Folder, run_dir: Folder | None) -> list[Argument]:
    return ["--cohort", cohort, *_options({"--run-dir": run_dir})]


def _options(options: Mapping[str, Argument | None]) -> list[Argument]:
    return [part for name, value in options.items() if value is not None for part in (name, value)]


def _assignments(values: Mapping[str, float | str] | None) -> list[Argument]:
    return [part for name, value in (values or {}).items() for part in ("--set", f"{name}={value}")]
