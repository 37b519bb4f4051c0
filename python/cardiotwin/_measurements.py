"""Measurements of one patient as arrays, and the files that the programs read."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cardiotwin._errors import InputError
from cardiotwin._names import unknown

if TYPE_CHECKING:
    import pandas as pd


class Arrays(TypedDict, total=False):
    """Keywords of `Measurements`."""

    time_ms: ArrayLike
    pressure_mmHg: ArrayLike
    volume_mL: ArrayLike | None
    volume_time_ms: ArrayLike | None
    cycle_length_ms: float
    end_diastolic_pressure_mmHg: float | None
    end_diastolic_volume_mL: float | None
    wall_volume_mL: float | None
    left_atrial_pressure_mmHg: float | None
    afterload: Mapping[str, float] | None
    more: Mapping[str, Any] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurements:
    """One beat of a patient. What is `None` is estimated by the programs, which say so."""

    time_ms: ArrayLike
    """Times of the pressure, and of the volume without ``volume_time_ms``; zero at end-diastole."""
    pressure_mmHg: ArrayLike
    """Pressure of the left ventricle."""
    volume_mL: ArrayLike | None = None
    """Volume of the left ventricle's cavity."""
    volume_time_ms: ArrayLike | None = None
    """Times of the volume, where they are others."""
    cycle_length_ms: float
    """Time from beat to beat."""
    end_diastolic_pressure_mmHg: float | None = None
    """Pressure at end-diastole, where it is known better than from the trace."""
    end_diastolic_volume_mL: float | None = None
    """Volume at end-diastole; needed without a volume trace."""
    wall_volume_mL: float | None = None
    """Volume of the left ventricle's wall."""
    left_atrial_pressure_mmHg: float | None = None
    """Mean filling pressure."""
    afterload: Mapping[str, float] | None = None
    """Three-element Windkessel: ``characteristic_resistance_mmHg_s_per_mL``,
    ``peripheral_resistance_mmHg_s_per_mL`` and ``compliance_mL_per_mmHg``."""
    more: Mapping[str, Any] | None = None
    """Further tables of ``patient.toml``: ``{"measured": {"noise": {"pressure_rms_mmHg": 1.0}}}``."""

    @classmethod
    def of(cls, columns: Mapping[str, ArrayLike] | pd.DataFrame, **values: Any) -> Measurements:
        """Measurements from columns with these names, such as those of a DataFrame; missing cells are left
        out. ``values`` are the other keywords."""
        names = [str(name) for name in columns]
        series: dict[str, Any] = {}
        for time, signal in (("time_ms", "pressure_mmHg"), ("volume_time_ms", "volume_mL")):
            for name in (time, signal):
                if name in names:
                    series[name] = np.asarray(columns[name], dtype=np.float64)
                elif name in ("time_ms", "pressure_mmHg"):
                    raise InputError(f"no column {unknown(name, names, 'the table has')}")
        alone = {time: signal for time, signal in _PAIRS.items() if time in series and signal in series}
        if "volume_mL" in series and "volume_time_ms" not in series:
            series["volume_time_ms"] = series["time_ms"]
            alone["volume_time_ms"] = "volume_mL"
        for time, signal in alone.items():
            there = np.isfinite(series[time]) & np.isfinite(series[signal])
            series[time], series[signal] = series[time][there], series[signal][there]
        return made({**series, **values})

    def write(self, folder: str | os.PathLike[str]) -> Path:
        """Writes ``patient.toml``, ``pressure.csv`` and ``volume.csv`` into a new folder, whose name becomes
        the patient's, and returns it. Raises `cardiotwin.InputError` for arrays that do not fit each other."""
        pressure = _trace("pressure_mmHg", self.pressure_mmHg, "time_ms", self.time_ms)
        files = {"pressure.csv": ("time_ms,pressure_mmHg", pressure)}
        if self.volume_mL is not None:
            own = self.volume_time_ms
            times, name = (self.time_ms, "time_ms") if own is None else (own, "volume_time_ms")
            files["volume.csv"] = ("time_ms,volume_mL", _trace("volume_mL", self.volume_mL, name, times))
        place = Path(folder)
        if (place / "patient.toml").exists():
            raise InputError(f"{place / 'patient.toml'} already exists: name another folder")
        text = _toml(self._tables(place.absolute().name))
        place.mkdir(parents=True, exist_ok=True)
        for name, (head, rows) in files.items():
            lines = (",".join(map(repr, row)) for row in rows.tolist())
            (place / name).write_text("\n".join([head, *lines, ""]), encoding="utf-8")
        (place / "patient.toml").write_text(text, encoding="utf-8")
        return place

    def _tables(self, name: str) -> dict[str, Any]:
        measured = {
            "pressure": "pressure.csv",
            "volume": None if self.volume_mL is None else "volume.csv",
            "end_diastolic_pressure_mmHg": self.end_diastolic_pressure_mmHg,
            "end_diastolic_volume_mL": self.end_diastolic_volume_mL,
        }
        tables: dict[str, Any] = {
            "id": name,
            "cycle_length_ms": self.cycle_length_ms,
            "measured": measured,
            "anatomy": {"wall_volume_mL": self.wall_volume_mL},
            "afterload": self.afterload,
            "preload": {"left_atrial_pressure_mmHg": self.left_atrial_pressure_mmHg},
        }
        return _without_nothing(_merged(tables, self.more or {}))


_PAIRS = {"time_ms": "pressure_mmHg", "volume_time_ms": "volume_mL"}


def made(arrays: Mapping[str, Any]) -> Measurements:
    """Measurements of keywords. Raises `InputError` for an unknown or a missing one."""
    known = [field.name for field in fields(Measurements)]
    for name in arrays:
        if name not in known:
            raise InputError(f"{unknown(name, known, 'measurements are')}")
    needed = ("time_ms", "pressure_mmHg", "cycle_length_ms")
    if missing := [name for name in needed if arrays.get(name) is None]:
        raise InputError(f"{missing[0]} is missing: measurements need {', '.join(needed)}")
    return Measurements(**arrays)


def _trace(name: str, values: ArrayLike, time_name: str, times: ArrayLike) -> NDArray[np.float64]:
    """Rows of time and value."""
    value, time = np.asarray(values, dtype=np.float64), np.asarray(times, dtype=np.float64)
    if value.ndim != 1 or value.shape != time.shape:
        raise InputError(f"{name} has shape {value.shape}, expected one value for each {time_name}, {time.shape}")
    for one, array in ((name, value), (time_name, time)):
        if not np.isfinite(array).all():
            at = int(np.flatnonzero(~np.isfinite(array))[0])
            raise InputError(f"{one}[{at}] is {array[at]}: leave out times without a measurement")
    return np.column_stack([time, value])


def _merged(tables: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Both, with those of ``more`` where both have a key that is no table."""
    merged = dict(tables)
    for key, value in more.items():
        there = merged.get(key)
        merged[key] = _merged(_table(there), _table(value)) if _is_table(there) and _is_table(value) else value
    return merged


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


def _table(value: Any) -> Mapping[str, Any]:
    return cast("Mapping[str, Any]", value)


def _without_nothing(tables: Mapping[str, Any]) -> dict[str, Any]:
    kept: dict[str, Any] = {}
    for key, value in tables.items():
        if _is_table(value):
            value = _without_nothing(_table(value))
            if not value:
                continue
        if value is not None:
            kept[key] = value
    return kept


def _toml(tables: Mapping[str, Any], path: str = "") -> str:
    """A table's values, then the tables in it under their names."""
    text = "".join(f"{_key(key)} = {_toml_value(value)}\n" for key, value in tables.items() if not _is_table(value))
    for key, value in tables.items():
        if _is_table(value):
            name = f"{path}.{_key(key)}" if path else _key(key)
            text += f"\n[{name}]\n{_toml(_table(value), name)}"
    return text


def _toml_value(value: Any) -> str:
    if _is_table(value):
        pairs = (f"{_key(key)} = {_toml_value(inner)}" for key, inner in _table(value).items())
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, np.generic | np.ndarray):
        value = cast("Any", value).tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(inner) for inner in cast("list[Any]", value)) + "]"
    raise InputError(f"{value!r} cannot be written into patient.toml: expected a number, a text, a list or a table")


def _key(key: str) -> str:
    return key if key.replace("_", "").replace("-", "").isalnum() and key.isascii() else json.dumps(key)
