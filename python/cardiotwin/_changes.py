"""Changes of a twin as people write them: ``resistance="-20 %"``."""

from __future__ import annotations

from collections.abc import Mapping

from cardiotwin._errors import UsageError
from cardiotwin._names import is_biomarker, near_misses, stem_and_unit, unknown
from cardiotwin._values import Values

Change = str | float

# Everyday words for loads whose full names are longer.
_EVERYDAY = {
    "resistance": "peripheral_resistance_mmHg_s_per_mL",
    "atrial_pressure": "left_atrial_pressure_mmHg",
    "filling_pressure": "left_atrial_pressure_mmHg",
}


def full_names(changes: Mapping[str, Change], known: Values) -> dict[str, Change]:
    """The same changes by full names. A name without its unit takes only a share, because a number needs a
    unit; names that look like none are left to the program, which knows what cannot be changed and why.

    Raises `UsageError` for a number without a unit, a misspelt name, and a quantity that is changed twice.
    """
    stems = {stem_and_unit(name)[0]: name for name in known}
    full: dict[str, Change] = {}
    for name, change in changes.items():
        meant = name if name in known else _EVERYDAY.get(name) or stems.get(name, name)
        if meant not in known and not is_biomarker(name) and near_misses(name, [*_EVERYDAY, *known]):
            raise UsageError(unknown(name, [*_EVERYDAY, *known]))
        if meant != name and not _is_share(change):
            raise UsageError(f"{name}={change}: a number needs its unit, {meant}={change}; a share is {name}='-20 %'")
        if meant in full:
            raise UsageError(f"{meant} is changed twice")
        full[meant] = change
    return full


def as_numbers(changes: Mapping[str, Change], known: Values) -> dict[str, float]:
    """Changes by full names as values, shares being those of ``known``."""
    return {name: _value(name, change, known) for name, change in full_names(changes, known).items()}


def _is_share(change: Change) -> bool:
    return isinstance(change, str) and change.strip().endswith("%")


def _value(name: str, change: Change, known: Values) -> float:
    text = change.strip() if isinstance(change, str) else change
    try:
        if isinstance(text, str) and text.endswith("%"):
            if text[0] not in "+-":
                raise UsageError(f"{name}: `{change}` has no sign; expected '+N %' or '-N %' of the twin's value")
            return known[name] * (1 + float(text[:-1]) / 100)
        return float(text)
    except ValueError:
        raise UsageError(f"{name}: `{change}` is neither a number nor a share such as '-20 %'") from None
