"""The effect of a change on a twin."""

from __future__ import annotations

import functools
import html
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cardiotwin._errors import UnknownNameError
from cardiotwin._extras import needs
from cardiotwin._html import aligned, number, picture, table
from cardiotwin._names import HelpfulAttributes, unit_of, unknown
from cardiotwin._values import Traces

if TYPE_CHECKING:
    import pandas as pd

_NAN = float("nan")


@dataclass(frozen=True)
class Predicted:
    """One index of a beat, in its unit. Values that could not be computed are NaN."""

    name: str
    unit: str
    twin: float
    """In the twin's own beat."""
    relative_change: float
    """Of the periodic state."""
    predicted: float
    """The twin's value with the change."""
    p5: float
    """Lower end of the 90 % interval; NaN without a band."""
    p95: float
    """Upper end of the 90 % interval; NaN without a band."""
    known: str
    """What is known of the change: `size`, `direction` or `neither`; empty where nothing was learnt."""


@dataclass(frozen=True)
class Changed:
    """A quantity that was changed, in the unit of its name."""

    name: str
    before: float
    after: float


class Prediction(HelpfulAttributes, Mapping[str, Predicted]):
    """Answer of `predict` for one twin: its indices by name, and its beat before and after."""

    def __init__(self, answer: Mapping[str, Any], before: Traces, after: Traces, figure: str) -> None:
        self.answer = dict(answer)
        """All of the program's answer."""
        self.before = before
        """Traces of the twin's own beat."""
        self.after = after
        """Traces of the predicted beat."""
        self.figure = figure
        """Pressure, volume and loop before and after, as SVG."""

    @functools.cached_property
    def _indices(self) -> dict[str, Predicted]:
        def one(row: Mapping[str, Any]) -> Predicted:
            low, high = row["band"] or (None, None)
            values = (row["twin"], row["relative_change"], row["predicted"], low, high)
            return Predicted(
                row["name"],
                unit_of(row["name"]),
                *(_NAN if value is None else float(value) for value in values),
                known=row["known"] or "",
            )

        return {row["name"]: one(row) for row in self.answer["indices"]}

    def __getitem__(self, name: str) -> Predicted:
        if name not in self._indices:
            raise UnknownNameError(unknown(name, self._indices))
        return self._indices[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._indices)

    def __len__(self) -> int:
        return len(self._indices)

    @property
    def patient(self) -> str:
        """Name of the patient."""
        return str(self.answer["patient"])

    @property
    def changes(self) -> list[Changed]:
        """What was changed."""
        return [Changed(row["key"], row["before"], row["after"]) for row in self.answer["changes"]]

    @property
    def personalised(self) -> bool:
        """Whether the twin is personalised; `remarks` say more."""
        return bool(self.answer["personalised"])

    @property
    def periodic(self) -> bool:
        """Whether both simulations reached their periodic state."""
        return bool(self.answer["periodic"])

    @property
    def circulation(self) -> str:
        """Circuit of both beats, `open` or `closed`."""
        return str(self.answer["circulation"])

    @property
    def band_covers(self) -> str:
        """What the 90 % intervals cover, in one sentence; empty without intervals."""
        return str(self.answer["band_covers"] or "")

    @property
    def remarks(self) -> list[str]:
        """Caveats, a sentence each."""
        return [str(remark) for remark in self.answer["remarks"]]

    @functools.cached_property
    def table(self) -> pd.DataFrame:
        """A row for each index: unit, the twin, the relative change, the prediction and its 90 % interval."""
        with needs("pandas"):
            import pandas as pd
        rows = [
            vars(self[row["name"]]) | {key: row[key] for key in ("simulated_before", "simulated_after")}
            for row in self.answer["indices"]
        ]
        return pd.DataFrame(rows).set_index("name")

    def _ipython_key_completions_(self) -> list[str]:
        return list(self)

    def _rows(self) -> list[tuple[str, str, float, str, float, str, str]]:
        def interval(row: Predicted) -> str:
            return f"{number(row.p5)} to {number(row.p95)}" if row.p5 == row.p5 else ""

        def percent(row: Predicted) -> str:
            return f"{100 * row.relative_change:+.1f} %" if row.relative_change == row.relative_change else ""

        return [(r.name, r.unit, r.twin, percent(r), r.predicted, interval(r), r.known) for r in self.values()]

    def _caveats(self) -> list[str]:
        return [f"90 % intervals: {self.band_covers}"] * bool(self.band_covers) + self.remarks

    def _said(self) -> str:
        made = "; ".join(f"{c.name} {number(c.before)} → {number(c.after)}" for c in self.changes)
        return f"{self.patient}: {made}"

    def _repr_html_(self) -> str:
        head = ["", "unit", "twin", "change", "predicted", "90 % interval", "known"]
        remarks = "".join(f"<p>{html.escape(remark)}</p>" for remark in self._caveats())
        return table(head, self._rows(), self._said()) + remarks + picture(self.figure, self._said())

    def __repr__(self) -> str:
        return "\n".join([self._said(), aligned(self._rows()), *self._caveats()])
