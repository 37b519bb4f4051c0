"""Cells and one-fibre ventricles in this process: single beats, and batches over NumPy arrays.

Equations, defaults and readings are those of the programs. Batches release Python's lock and use
one thread for each core unless ``threads`` says otherwise; Ctrl-C ends them.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cardiotwin import _native
from cardiotwin._errors import UnknownNameError
from cardiotwin._extras import needs
from cardiotwin._names import HelpfulAttributes, near_misses, unknown
from cardiotwin._values import Draws, Traces, Values

if TYPE_CHECKING:
    import pandas as pd

CYCLE_LENGTH_MS = 1000.0
"""Cycle length of the published sensitivity analysis."""
LAMBDA_0 = 1.1
"""Initial stretch of the published sensitivity analysis."""
TOLERANCE = 1e-4
"""Default tolerance of the engine."""


def cell_parameters() -> pd.DataFrame:
    """Parameters of the cell by name: unit, meaning, default, interval of the sensitivity analysis."""
    with needs("pandas"):
        import pandas as pd
    rows = [
        (name, unit, meaning, default, *(interval or (np.nan, np.nan)))
        for name, unit, meaning, default, interval in _native.cell_parameters()
    ]
    columns = ["parameter", "unit", "meaning", "default", "lower", "upper"]
    return pd.DataFrame(rows, columns=columns).set_index("parameter")


@dataclass(frozen=True)
class Beat(HelpfulAttributes):
    """One beat: biomarkers by name, traces by column, and all of the answer."""

    biomarkers: Values
    traces: Traces
    answer: dict[str, Any]


@dataclass(frozen=True)
class Cells(HelpfulAttributes):
    """Results of a batch, a row for each set of parameters. Rows without a beat are NaN."""

    biomarkers: NDArray[np.float64]
    """Sets × biomarkers."""
    names: list[str]
    """Names of the biomarkers."""
    units: list[str]
    """Units of the biomarkers; empty for dimensionless ones."""
    status: NDArray[np.str_]
    """Cells: `periodic`, `not-periodic`, `stuck`, `refused`; ventricles: `finished`, `diverged`, `refused`."""
    valves_opened: NDArray[np.bool_] | None = None
    """Whether both valves of a ventricle opened and closed."""
    refused: Mapping[int, str] | None = None
    """Words about the refused sets of a ventricle, by row."""

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """All values of one biomarker."""
        if name not in self.names:
            raise UnknownNameError(unknown(name, self.names))
        return self.biomarkers[:, self.names.index(name)]

    def frame(self) -> pd.DataFrame:
        """Biomarkers and status as a table."""
        with needs("pandas"):
            import pandas as pd
        return pd.DataFrame(self.biomarkers, columns=self.names).assign(status=self.status)


def cell_beat(
    parameters: Mapping[str, float] | None = None,
    *,
    cycle_length_ms: float = CYCLE_LENGTH_MS,
    lambda_0: float = LAMBDA_0,
    tolerance: float = TOLERANCE,
) -> Beat:
    """The periodic beat of one cell. Raises `ModelError` for an unknown name, a value outside of the
    model's range, or a cell without a beat."""
    answer = _native.cell_beat(_floats(parameters, _cell_names()), cycle_length_ms, lambda_0, tolerance)
    biomarkers = cast("dict[str, float]", answer.pop("biomarkers"))
    traces = cast("dict[str, NDArray[np.float64]]", answer.pop("traces"))
    return Beat(Values(biomarkers), Traces(traces), dict(answer))


def cell_beats(
    values: ArrayLike,
    names: Iterable[str],
    parameters: Mapping[str, float] | None = None,
    *,
    cycle_length_ms: float = CYCLE_LENGTH_MS,
    lambda_0: float = LAMBDA_0,
    tolerance: float = TOLERANCE,
    negative_kwu: str = "keep",
    threads: int = 0,
) -> Cells:
    """Periodic beats of many cells.

    ``values`` has a row for each set and a column for each of ``names``; other parameters are those
    of ``parameters`` or their defaults. ``negative_kwu`` is ``keep``, as in the published analysis,
    or ``refuse``, as in step 2.
    """
    if negative_kwu not in ("keep", "refuse"):
        raise _native.ModelError(f"negative_kwu is {negative_kwu!r}, expected 'keep' or 'refuse'")
    columns = _columns(names, _cell_names())
    found, _, status = _native.cell_batch(
        _sets(values, columns),
        columns,
        _floats(parameters, _cell_names()),
        cycle_length_ms,
        lambda_0,
        tolerance,
        negative_kwu == "refuse",
        threads,
    )
    labels = _native.cell_biomarkers()
    return Cells(found, [label[0] for label in labels], [label[1] for label in labels], np.array(status, dtype=np.str_))


class Ventricle(HelpfulAttributes):
    """A beat of a one-fibre ventricle with its loads, valves and contraction model."""

    def __init__(self, specification: str | Mapping[str, Any]) -> None:
        """The ventricle of a beat's specification, as `simulate` and `Patient` give it."""
        text = specification if isinstance(specification, str) else json.dumps(specification)
        self._native = _native.Ventricle(text)

    @classmethod
    def _of(cls, native: _native.Ventricle) -> Ventricle:
        ventricle = cls.__new__(cls)
        ventricle._native = native
        return ventricle

    @classmethod
    def average(cls) -> Ventricle:
        """A ventricle in the middle of the bundled cohort, with Tanh."""
        return cls._of(_native.Ventricle.average())

    @property
    def parameters(self) -> Values:
        """Value of each parameter by name, which carries the unit."""
        return Values(dict(self._native.parameters()))

    @property
    def specification(self) -> dict[str, Any]:
        """All of the beat, as the worker takes it."""
        return cast("dict[str, Any]", json.loads(self._native.specification()))

    def changed(self, parameters: Mapping[str, float] | None = None, *, beats: int | None = None) -> Ventricle:
        """The same ventricle with other values of parameters, and another number of beats."""
        return self._of(self._native.changed(_floats(parameters, self.parameters), beats))

    def with_cell(self, parameters: Mapping[str, float] | None = None, *, lambda_0: float = 1.0) -> Ventricle:
        """The same ventricle with Land's and Rice's cell."""
        cell = self._native.with_cell({}, lambda_0)
        return self._of(cell.changed(_floats(parameters, Values(dict(cell.parameters()))), None))

    def beat(self, parameters: Mapping[str, float] | None = None) -> Beat:
        """The beat, with other values of parameters where some are given. Raises `ModelError` where it
        diverges or a model rejects a value."""
        native = self.changed(parameters)._native if parameters else self._native
        text, traces = native.beat()
        answer = cast("dict[str, Any]", json.loads(text))
        answer.pop("samples", None)
        return Beat(Values(answer.pop("biomarkers")), Traces(traces), answer)

    def beats(self, values: ArrayLike | Draws, names: Iterable[str] = (), *, threads: int = 0) -> Cells:
        """Beats of many sets of parameters: ``values`` has a row for each set and a column for each of
        ``names``. Draws of a posterior have names of their own."""
        columns = _columns(values.names if isinstance(values, Draws) else names, self.parameters)
        found, opened, status, refused = self._native.batch(_sets(values, columns), columns, threads)
        labels = _native.organ_biomarkers()
        keys, units = [label[0] for label in labels], [label[1] for label in labels]
        return Cells(found, keys, units, np.array(status, dtype=np.str_), opened, refused)

    def __repr__(self) -> str:
        of = self.specification
        return f"<cardiotwin.Ventricle {of['contraction']['model']}, {of['cycle_length_ms']} ms>"


def _cell_names() -> list[str]:
    return [row[0] for row in _native.cell_parameters()]


def _floats(parameters: Mapping[str, float] | None, known: Iterable[str]) -> dict[str, float]:
    _refuse_unknown(parameters or {}, known)
    return {name: float(value) for name, value in (parameters or {}).items()}


def _columns(names: Iterable[str], known: Iterable[str]) -> list[str]:
    if isinstance(names, str):
        raise _native.ModelError("names is a text, expected a list of names")
    columns = list(names)
    _refuse_unknown(columns, known)
    return columns


def _refuse_unknown(names: Iterable[str], known: Iterable[str]) -> None:
    """Says what was meant before the models list all that they have."""
    known = list(known)
    for name in names:
        if name not in known and near_misses(name, known):
            raise _native.ModelError(f"no parameter {unknown(name, known)}")


def _sets(values: ArrayLike, names: list[str]) -> NDArray[np.float64]:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != len(names):
        raise _native.ModelError(
            f"values have shape {array.shape}, expected (number of sets, {len(names)}): a column for each name"
        )
    return array
