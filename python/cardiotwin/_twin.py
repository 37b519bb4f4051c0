"""A personalised twin: its values, its posterior, and what it does under other loads."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cardiotwin import _commands
from cardiotwin._changes import Change, as_numbers, full_names
from cardiotwin._commands import Simulation
from cardiotwin._errors import StoreError, UnknownNameError, UsageError
from cardiotwin._extras import needs
from cardiotwin._html import aligned, number, table
from cardiotwin._models import Ventricle
from cardiotwin._names import HelpfulAttributes, unit_of, unknown
from cardiotwin._prediction import Prediction
from cardiotwin._values import Draws, Traces, Values

if TYPE_CHECKING:
    import pandas as pd

    from cardiotwin._run import Patient


class Twin(HelpfulAttributes):
    """The personalised ventricle of a patient: step 3's best beat, or the verification beat without step 3."""

    def __init__(self, patient: Patient) -> None:
        steps = [
            step for step in ("step3", "step2") if any(row[step] is not None for row in patient.tables["biomarkers"])
        ]
        if not steps:
            raise StoreError(
                f"{patient.name} has no twin yet ({patient.status['step']} {patient.status['state']}): "
                "run the cohort first"
            )
        self.patient = patient
        self.name = patient.name
        self.step: str = steps[0]
        """``step3`` or ``step2``, whose beat this is."""

    @functools.cached_property
    def ventricle(self) -> Ventricle:
        """The twin for this process: `Patient.ventricle`."""
        return self.patient.ventricle

    @functools.cached_property
    def parameters(self) -> Values:
        """Loads, valves, wall and cell, in the units of their names."""
        return self.ventricle.parameters

    @functools.cached_property
    def biomarkers(self) -> Values:
        """Biomarkers of the twin's own beat."""
        return Values({row["biomarker"]: row[self.step] for row in self.patient.tables["biomarkers"]})

    @functools.cached_property
    def traces(self) -> Traces:
        """Traces of the twin's own beat. Those with other times are in `Patient.traces`."""
        own = [trace for trace in self.patient.tables["traces"] if trace["source"] == self.step]
        if not own:
            raise StoreError(f"{self.name}: the traces of the twin's beat cannot be read: {self._problems()}")
        times = own[0]["time_ms"]
        return Traces({"time_ms": times} | {_column(t): t["value"] for t in own if t["time_ms"] == times})

    def _problems(self) -> str:
        return "; ".join(self.patient.tables["problems"]) or "the run has none"

    @property
    def personalised(self) -> bool:
        """Whether the twin agrees with the measurements within the run's tolerance; `verdict` says how far."""
        return bool((self.verdict or {}).get("personalised"))

    @property
    def verdict(self) -> dict[str, Any] | None:
        """Agreement of the twin's beat with the measured biomarkers; `None` without a verification beat."""
        verdict: dict[str, Any] | None = self.patient.tables["verdict"]
        return verdict

    @property
    def posterior(self) -> Posterior:
        """What the measurements say about the twin's parameters. Raises `StoreError` where the run sampled
        no posterior."""
        if not self.patient.tables["posterior"]:
            # Asked for, but no draw could be made.
            if why := self.patient.tables.get("without_intervals"):
                raise StoreError(f"{self.name}: {why}")
            raise StoreError(
                f"{self.name}: the run sampled no posterior; run the cohort with settings={{'posterior.enabled': True}}"
            )
        return Posterior(self.name, self.patient.tables["posterior"], self.patient.tables["draws"])

    def predict(
        self,
        changes: Mapping[str, Change] | None = None,
        /,
        *,
        beats: int | None = None,
        circulation: _commands.Circulation = "open",
        in_3d: bool = False,
        band: bool = True,
        **quantities: Change,
    ) -> Prediction:
        """The effect of a treatment (``cardiotwin predict``): ``twin.predict(resistance="-20 %")``.

        A quantity is one of `parameters`, as a value in its unit or as a share of the twin's value with its
        sign. For shares the unit may be left out of the name, and ``resistance`` is the peripheral one.
        ``beats`` fixes their number, in a ``closed`` circulation filling follows the change, ``in_3d`` simulates
        the run's 3D ventricle, ``band`` adds intervals from the posterior. Raises `UsageError` for a quantity that
        cannot be changed, with the reason.
        """
        asked = full_names(_both(changes, quantities), self.parameters)
        if not asked:
            raise UsageError("predict: name what changes, such as resistance='-20 %'")
        return _commands.predict(
            self.name,
            set=asked,
            beats=beats,
            circulation=circulation,
            in_3d=in_3d,
            band=band,
            cohort=self.patient.place.cohort,
            run_dir=self.patient.place.run_dir,
        )

    def beat(
        self,
        changes: Mapping[str, Change] | None = None,
        /,
        *,
        beats: int | str | None = None,
        circulation: _commands.Circulation = "open",
        **quantities: Change,
    ) -> Simulation:
        """The twin's beat in the run's ventricle, with other values of quantities where some are given
        (``cardiotwin simulate``). They are written as for `predict`; ``beats`` is a number or ``"periodic"``.
        `ventricle` does the same for one-fibre twins in this process. Raises `UsageError` for an unknown quantity."""
        own = {
            row["parameter"]: float(row["value"]) for row in self.patient.tables["parameters"] if row["step"] == "step3"
        }
        asked = as_numbers(_both(changes, quantities), self.parameters)
        return _commands.simulate(
            self.name,
            set={**own, **asked},
            beats=beats,
            circulation=circulation,
            cell=True,
            cohort=self.patient.place.cohort,
            run_dir=self.patient.place.run_dir,
        )

    def _said(self) -> str:
        words = "personalised" if self.personalised else "not personalised"
        return f"{self.name}: {self.patient.status['note'] or words}"

    def _repr_html_(self) -> str:
        rows = [
            (row["biomarker"], row["unit"], row["measured"], row[self.step], row["meaning"])
            for row in self.patient.tables["biomarkers"]
        ]
        return table(["", "unit", "measured", "twin", ""], rows, self._said())

    def __repr__(self) -> str:
        return f"<cardiotwin.Twin {self._said()}>"


@dataclass(frozen=True)
class Interval:
    """Knowledge about one parameter, in its unit: quantiles at 5, 50 and 95 %."""

    unit: str
    twin: float
    """Value in the twin."""
    p5: float
    p50: float
    p95: float
    prior_p5: float
    """Before the measurements."""
    prior_p50: float
    prior_p95: float
    mark: str
    """How well the data determine it: ``determined``, ``sloppy`` (weakly identified) or ``not-determined``."""


class Posterior(HelpfulAttributes, Mapping[str, Interval]):
    """Parameters of a twin given the measurements: an interval for each, and draws of all together."""

    def __init__(self, patient: str, rows: list[dict[str, Any]], draws: list[list[float]]) -> None:
        self._patient = patient
        self._rows = {
            str(row["parameter"]): Interval(
                unit=unit_of(row["parameter"]),
                **{key: value for key, value in row.items() if key not in ("parameter", "unit")},
            )
            for row in rows
        }
        self.draws = Draws(np.array(draws, dtype=np.float64).reshape(-1, len(self._rows)), list(self._rows))
        """All draws that the run stores."""

    def sample(self, n: int, *, seed: int | None = None, replace: bool = False) -> Draws:
        """``n`` of the stored draws, in an order by ``seed``; each at most once unless ``replace``.

        Raises `UsageError` where the run stores fewer: no further ones are made up.
        """
        stored = len(self.draws)
        if not 0 < n <= stored and not (replace and n > 0):
            raise UsageError(
                f"{self._patient}: {n} draws are wanted, and the run stores {stored}; take 1 to {stored}, draw some "
                f"more than once with replace=True, or run the cohort with "
                f"settings={{'posterior.draws': {max(n, stored)}}} and yes=True"
            )
        chosen = np.random.default_rng(seed).choice(stored, size=n, replace=replace)
        return Draws(self.draws.values[chosen], self.draws.names)

    def __getitem__(self, name: str) -> Interval:
        if name not in self._rows:
            raise UnknownNameError(unknown(name, self._rows))
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def frame(self) -> pd.DataFrame:
        """A row for each parameter."""
        with needs("pandas"):
            import pandas as pd
        return (
            pd.DataFrame({name: vars(row) for name, row in self._rows.items()})
            .T.infer_objects()
            .rename_axis("parameter")
        )

    def _ipython_key_completions_(self) -> list[str]:
        return list(self)

    def _cells(self) -> list[tuple[str, str, float, str, str, str]]:
        return [
            (
                name,
                r.unit,
                r.twin,
                f"{number(r.p5)} to {number(r.p95)}",
                f"{number(r.prior_p5)} to {number(r.prior_p95)}",
                _WORDS[r.mark],
            )
            for name, r in self._rows.items()
        ]

    def _repr_html_(self) -> str:
        head = ["", "unit", "twin", "90 % interval", "before the measurements", ""]
        return table(head, self._cells(), f"{self._patient}: {len(self.draws)} draws")

    def __repr__(self) -> str:
        return f"{self._patient}: {len(self.draws)} draws\n{aligned(self._cells())}"


_WORDS = {"determined": "determined", "sloppy": "weakly identified", "not-determined": "not determined"}


def _both(changes: Mapping[str, Change] | None, quantities: Mapping[str, Change]) -> dict[str, Change]:
    if twice := set(changes or {}) & set(quantities):
        raise UsageError(f"{min(twice)} is changed twice")
    return {**(changes or {}), **quantities}


def _column(trace: Mapping[str, Any]) -> str:
    """Name of a trace with its unit."""
    unit = str(trace["unit"]).replace("/", "_per_")
    return str(trace["signal"]) if unit == "1" else f"{trace['signal']}_{unit}"
