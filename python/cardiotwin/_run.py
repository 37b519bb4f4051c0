"""Runs and the results of their patients. Everything is read when it is asked for."""

from __future__ import annotations

import functools
import html
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cardiotwin._errors import StoreError, UnknownNameError
from cardiotwin._extras import needs
from cardiotwin._html import status_table
from cardiotwin._models import Ventricle
from cardiotwin._names import HelpfulAttributes, unknown
from cardiotwin._program import call, call_json
from cardiotwin._twin import Twin

if TYPE_CHECKING:
    import pandas as pd
    import polars
    import pyvista
    import xarray

Folder = str | os.PathLike[str]
# Names of patients are short and alike, so that only nearly the same is taken for a slip.
_SLIP = 0.8
_MOST_SHOWN = 10


class Place:
    """Folders of a run. A temporary folder is removed with it."""

    def __init__(self, cohort: Folder, run_dir: Folder | None) -> None:
        self.cohort = Path(cohort)
        self.run_dir = Path(run_dir) if run_dir is not None else None

    def options(self, *before: Folder) -> list[Folder]:
        """The cohort, behind ``before``, and the run's folder where it is another one."""
        place = [*before, self.cohort]
        return place if self.run_dir is None else [*place, "--run-dir", self.run_dir]

    def status(self) -> dict[str, Any]:
        """Where the run and each patient stand now."""
        return call_json("status", *self.options(), "--json")


# Without HelpfulAttributes, and with patients in a plain attribute, because IPython evaluates no code to
# complete `run.patients["`.
class Run:
    """Results of a cohort so far."""

    patients: Patients
    """Results by patient."""

    def __init__(self, cohort: Folder | Place, run_dir: Folder | None = None) -> None:
        self.place = cohort if isinstance(cohort, Place) else Place(cohort, run_dir)
        self.patients = Patients(self.place)

    @property
    def run_dir(self) -> Path | None:
        """Folder of the run; `None` where it is in the cohort's."""
        return self.place.run_dir

    @property
    def cohort(self) -> Path:
        """Folder of the cohort."""
        return self.place.cohort

    @property
    def status(self) -> dict[str, Any]:
        """Where the run and each patient stand now."""
        return self.place.status()

    @property
    def table(self) -> pd.DataFrame:
        """A row for each patient, failures first."""
        with needs("pandas"):
            import pandas as pd
        return pd.DataFrame(self.status["patients"]).set_index("patient")

    def report(self, out: Folder | None = None) -> Path:
        """Writes the report, one HTML file that needs no network, and returns its path."""
        arguments = ["report", *self.place.options(), *(["--out", out] if out is not None else [])]
        return Path(call(*arguments, accept=(0, 1, 7)).strip())  # 7: a twin is off

    def export(self, out: Folder, *options: str) -> list[Path]:
        """Writes tables and traces into a folder and returns the files; ``options`` are those of
        ``cardiotwin export``, such as ``--opencarp``."""
        answer = call_json("export", *self.place.options(), "--out", out, "--json", *options, accept=(0, 1))
        return [Path(file) for file in answer["files"]]

    def _repr_html_(self) -> str:
        return status_table(self.status)

    def __repr__(self) -> str:
        return f"<cardiotwin.Run of {self.cohort}>"


class Patients(HelpfulAttributes, Mapping[str, "Patient"]):
    """Results by the patient's name, as the run has them whenever they are asked for."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._known: set[str] = set()

    def _states(self) -> dict[str, str]:
        states = {patient["patient"]: patient["state"] for patient in self._place.status()["patients"]}
        self._known.update(states)
        return dict(sorted(states.items()))

    def __getitem__(self, name: str) -> Patient:
        # A run keeps its patients, so that one that was seen is there.
        if name not in self._known and name not in (states := self._states()):
            raise UnknownNameError(unknown(name, states, "the run has", cutoff=_SLIP))
        return Patient(self._place, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._states())

    def __len__(self) -> int:
        return len(self._states())

    def _ipython_key_completions_(self) -> list[str]:
        return list(self)

    def _repr_html_(self) -> str:
        return status_table(self._place.status())

    def __repr__(self) -> str:
        states = self._states()
        shown = ", ".join(f"{name} ({state})" for name, state in list(states.items())[:_MOST_SHOWN])
        more = f", … {len(states) - _MOST_SHOWN} more" if len(states) > _MOST_SHOWN else ""
        return f"<{len(states)} patients of {self._place.cohort}: {shown}{more}>"


class Patient(HelpfulAttributes):
    """Results of one patient, read once when they are first asked for; `refresh` forgets them."""

    def __init__(self, place: Place, name: str) -> None:
        self.place = place
        self.name = name

    @property
    def run(self) -> Run:
        """The run that the patient belongs to."""
        return Run(self.place)

    def _show(self, *options: str) -> str:
        return call("show", self.name, *self.place.options("--cohort"), *options)

    @functools.cached_property
    def tables(self) -> dict[str, Any]:
        """All tables as lists, without pandas (``cardiotwin show --tables``)."""
        tables: dict[str, Any] = json.loads(self._show("--tables"))
        return tables

    @functools.cached_property
    def record(self) -> dict[str, Any]:
        """All about the patient, with provenance (``cardiotwin show --json``)."""
        record: dict[str, Any] = json.loads(self._show("--json"))
        return record

    def refresh(self) -> Patient:
        """The same patient as the run has it now."""
        return Patient(self.place, self.name)

    @property
    def twin(self) -> Twin:
        """The personalised ventricle: values, posterior, predictions. Raises `StoreError` before there is one."""
        return Twin(self)

    @property
    def status(self) -> dict[str, Any]:
        """Step, state and note."""
        status: dict[str, Any] = self.tables["status"]
        return status

    @property
    def biomarkers(self) -> pd.DataFrame:
        """Measured and simulated biomarkers: a row for each, with its unit; a column for each step."""
        with needs("pandas"):
            import pandas as pd
        return pd.DataFrame(self.tables["biomarkers"]).set_index("biomarker")

    @property
    def parameters(self) -> pd.DataFrame:
        """Personalised parameters: a row for each step and parameter, with its unit."""
        with needs("pandas"):
            import pandas as pd
        rows = pd.DataFrame(self.tables["parameters"], columns=["step", "parameter", "unit", "value"])
        return rows.set_index(["step", "parameter"])

    @property
    def posterior(self) -> pd.DataFrame:
        """Quantiles of each parameter after and before the measurements; empty before it was sampled."""
        with needs("pandas"):
            import pandas as pd
        columns = ["parameter", "unit", "twin", "p5", "p50", "p95", "prior_p5", "prior_p50", "prior_p95", "mark"]
        return pd.DataFrame(self.tables["posterior"], columns=columns).set_index("parameter")

    @property
    def draws(self) -> pd.DataFrame:
        """Draws of the posterior: a row for each draw, a column for each parameter."""
        with needs("pandas"):
            import pandas as pd
        return pd.DataFrame(self.tables["draws"], columns=list(self.posterior.index))

    @property
    def traces(self) -> pd.DataFrame:
        """All traces, one value a row: source, signal, unit, time_ms, value."""
        with needs("pandas"):
            import pandas as pd
        return pd.DataFrame(self._long())

    def _long(self) -> dict[str, list[Any]]:
        """Columns of all traces."""
        columns: dict[str, list[Any]] = {name: [] for name in ("source", "signal", "unit", "time_ms", "value")}
        for trace in self.tables["traces"]:
            for name in ("source", "signal", "unit"):
                columns[name] += [trace[name]] * len(trace["value"])
            columns["time_ms"] += trace["time_ms"]
            columns["value"] += trace["value"]
        return columns

    @property
    def traces_polars(self) -> polars.DataFrame:
        """`traces` for polars (extra ``polars``)."""
        with needs("polars"):
            import polars
        return polars.DataFrame(self._long())

    @property
    def traces_xarray(self) -> dict[str, xarray.Dataset]:
        """Traces by source, each signal over its times as an array with its unit (extra ``xarray``)."""
        with needs("xarray"):
            import xarray
        sets: dict[str, dict[str, xarray.DataArray]] = {}
        for trace in self.tables["traces"]:
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
        beat = self.tables["beat"]
        if beat is None:
            raise StoreError(f"{self.name}: step 0 is not done; run the cohort first")
        return Ventricle(beat)

    @property
    def mesh(self) -> pyvista.MultiBlock:
        """The twin's 3D wall for PyVista (extra ``pyvista``): the half behind a plane through the long
        axis, a block for each of end-diastole and end-systole, with stress and stretch."""
        file = self.tables["heart"]
        if file is None:
            raise StoreError(f"{self.name}: the run has no 3D beat; run with fidelity='finite-element'")
        with needs("pyvista"):
            from cardiotwin._mesh import heart
        return heart(Path(file))

    @property
    def series(self) -> pyvista.PVDReader:
        """The twin's series of the whole mesh over the beat, where the run wrote one
        (``settings={"executor.vtu_every_ms": 10}``), as PyVista's reader."""
        file = self.tables["series"]
        if file is None:
            raise StoreError(f"{self.name}: the run wrote no series; set executor.vtu_every_ms in a 3D run")
        with needs("pyvista"):
            import pyvista
        return pyvista.PVDReader(file)

    def _repr_html_(self) -> str:
        page = self._show("--html")
        return f'<iframe srcdoc="{html.escape(page)}" width="100%" height="640" style="border:0"></iframe>'

    def __repr__(self) -> str:
        words = dict.fromkeys((self.status["step"], self.status["state"], self.status["note"]))  # "done" once
        return f"<cardiotwin.Patient {self.name}: {', '.join(filter(None, words))}>"
