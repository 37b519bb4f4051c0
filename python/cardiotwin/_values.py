"""Values, traces and draws by names that carry units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from cardiotwin._errors import UnknownNameError
from cardiotwin._extras import needs
from cardiotwin._html import aligned, table
from cardiotwin._names import HelpfulAttributes, unit_of, unknown

if TYPE_CHECKING:
    import pandas as pd
    import xarray


class Values(Mapping[str, float]):
    """Numbers by name, each with its unit: biomarkers or parameters. A name is a key and an attribute."""

    def __init__(self, values: Mapping[str, float | None]) -> None:
        self._values = {name: float("nan") if value is None else float(value) for name, value in values.items()}

    @overload
    def __getitem__(self, name: str) -> float: ...
    @overload
    def __getitem__(self, name: list[str]) -> Values: ...
    def __getitem__(self, name: str | list[str]) -> float | Values:
        if isinstance(name, list):
            return Values({one: self[one] for one in name})
        if name not in self._values:
            raise UnknownNameError(unknown(name, self._values))
        return self._values[name]

    def __getattr__(self, name: str) -> float:
        values: Mapping[str, float] = self.__dict__.get("_values", {})
        if name.startswith("_") or name not in values:
            raise AttributeError(unknown(name, values))
        return values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each value by name; empty for a dimensionless one."""
        return {name: unit_of(name) for name in self._values}

    def array(self) -> NDArray[np.float64]:
        """The values in order."""
        return np.array(list(self._values.values()), dtype=np.float64)

    def series(self) -> pd.Series[float]:
        """The values for pandas."""
        with needs("pandas"):
            import pandas as pd
        return pd.Series(self._values, dtype=float)

    def frame(self) -> pd.DataFrame:
        """A row for each value: ``value`` and ``unit``."""
        with needs("pandas"):
            import pandas as pd
        return pd.DataFrame({"value": self._values, "unit": self.units}).rename_axis("name")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._values]

    def _ipython_key_completions_(self) -> list[str]:
        return list(self._values)

    def html(self) -> str:
        """The values as a table, which notebooks show."""
        return table(["", "value", "unit"], self._rows())

    def _repr_html_(self) -> str:
        return self.html()

    def __repr__(self) -> str:
        return aligned(self._rows()) or "no values"

    def _rows(self) -> list[tuple[str, float, str]]:
        return [(name, value, unit_of(name)) for name, value in self._values.items()]


class Traces(HelpfulAttributes, Mapping[str, NDArray[np.float64]]):
    """Signals of one beat over common times: an array for each, by a name with the unit. ``time_ms`` is
    one of them."""

    def __init__(self, columns: Mapping[str, ArrayLike]) -> None:
        self._columns = {name: np.asarray(column, dtype=np.float64) for name, column in columns.items()}

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        if name not in self._columns:
            raise UnknownNameError(unknown(name, self._columns))
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each signal by name; empty for a dimensionless one."""
        return {name: unit_of(name) for name in self._columns}

    def frame(self) -> pd.DataFrame:
        """A column for each signal, a row for each time."""
        with needs("pandas"):
            import pandas as pd
        return pd.DataFrame(self._columns)

    def dataset(self) -> xarray.Dataset:
        """Signals over the coordinate ``time_ms``, with their units in ``attrs["units"]``."""
        with needs("xarray"):
            import xarray
        signals = {
            name: xarray.DataArray(column, dims=["time_ms"], attrs={"units": unit_of(name)})
            for name, column in self._columns.items()
            if name != "time_ms"
        }
        return xarray.Dataset(signals, coords={"time_ms": ("time_ms", self["time_ms"], {"units": "ms"})})

    def _ipython_key_completions_(self) -> list[str]:
        return list(self._columns)

    def _repr_html_(self) -> str:
        return table(["", "unit", "smallest", "largest"], self._rows(), self._size())

    def __repr__(self) -> str:
        return f"{self._size()}\n{aligned(self._rows())}" if self._columns else "no traces"

    def _size(self) -> str:
        return f"{max((len(column) for column in self._columns.values()), default=0)} times"

    def _rows(self) -> list[tuple[str, str, float, float]]:
        return [
            (name, unit_of(name), float(np.nanmin(column)), float(np.nanmax(column)))
            for name, column in self._columns.items()
        ]


@dataclass(frozen=True)
class Draws(HelpfulAttributes):
    """Draws of a posterior: sets of parameters that agree with the measurements."""

    values: NDArray[np.float64]
    """Draws × parameters, as `Ventricle.beats` takes them."""
    names: list[str]
    """Names of the parameters, with their units."""

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[np.float64]:
        array = np.asarray(self.values, dtype=dtype)
        return array.copy() if copy else array

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """All values of one parameter."""
        if name not in self.names:
            raise UnknownNameError(unknown(name, self.names))
        return self.values[:, self.names.index(name)]

    @property
    def units(self) -> dict[str, str]:
        """Unit of each parameter by name; empty for a dimensionless one."""
        return {name: unit_of(name) for name in self.names}

    def frame(self) -> pd.DataFrame:
        """A row for each draw, a column for each parameter."""
        with needs("pandas"):
            import pandas as pd
        return pd.DataFrame(self.values, columns=self.names)

    def _ipython_key_completions_(self) -> list[str]:
        return self.names

    def _repr_html_(self) -> str:
        return table(self.names, self.values[:5].tolist(), f"{len(self)} draws, the first five")

    def __repr__(self) -> str:
        return f"<{len(self)} draws of {', '.join(self.names)}>"
