"""Names that carry units: what was meant by a misspelt one, and the unit of one."""

from __future__ import annotations

import difflib
import functools
from collections.abc import Iterable
from typing import TYPE_CHECKING

from cardiotwin import _native

# Parts of names that are units, as the vocabulary of the programs writes them.
_UNITS = frozenset({"mmHg", "kPa", "mL", "L", "ms", "s", "uM", "mJ", "mm", "percent"})
_CUTOFF = 0.6
_MOST_NAMED = 20


def stem_and_unit(name: str) -> tuple[str, str]:
    """A name without its unit, and the unit: ``compliance``, ``mL/mmHg`` for ``compliance_mL_per_mmHg``.

    The unit is that of the vocabulary where it has the name, and else the end of the name.
    """
    parts = name.split("_")
    start = len(parts)
    while start > 1 and _is_of_unit(parts[start - 1], parts[start - 2]):
        start -= 1
    known = _vocabulary().get(name)
    if start == len(parts) or known == "":
        return name, known or ""
    above, _, below = "_".join(parts[start:]).partition("per_")
    above, below = ("·".join(side.strip("_").split("_")) for side in (above, below))
    spelt = f"{above or '1'}/{below}" if below else above
    return "_".join(parts[:start]), known or spelt.replace("uM", "µM")


def _is_of_unit(part: str, before: str) -> bool:
    """Whether a part of a name belongs to its unit. A minute comes after `per`; elsewhere, `min` is a minimum."""
    return part in _UNITS or part == "per" or (part == "min" and before == "per")


def unit_of(name: str) -> str:
    """Unit of a quantity by its name; empty for a dimensionless one."""
    return stem_and_unit(name)[1]


def is_biomarker(name: str) -> bool:
    """Whether a beat gives this quantity."""
    return any(name == row[0] for row in _native.organ_biomarkers())


@functools.cache
def _vocabulary() -> dict[str, str]:
    rows = [row[:2] for row in _native.cell_parameters()]
    rows += [row[:2] for row in (*_native.cell_biomarkers(), *_native.organ_biomarkers())]
    return dict(rows)


def near_misses(name: str, known: Iterable[str], cutoff: float = _CUTOFF) -> list[str]:
    """At most three of ``known`` that look like ``name``, the most alike first. Case, separators and
    units do not count."""

    def likeness(other: str) -> float:
        asked = _letters(name)
        forms = [_letters(other), _letters(stem_and_unit(other)[0])]
        alike = [difflib.SequenceMatcher(None, asked, form, autojunk=False).ratio() for form in forms]
        inside = len(asked) > 3 and asked in forms[1]
        return max(*alike, cutoff if inside else 0.0)

    ranked = sorted(((likeness(other), other) for other in known), key=lambda pair: -pair[0])
    close = [(score, other) for score, other in ranked if score >= cutoff][:3]
    # Names that are much less alike than the best were not meant; beside one that is right but for case,
    # separators and unit, none was.
    return [other for score, other in close if score >= (1 if close[0][0] == 1 else close[0][0] - 0.15)]


def unknown(name: str, known: Iterable[str], has: str = "expected one of", cutoff: float = _CUTOFF) -> str:
    """Words about an unknown name: what was probably meant, or what there is."""
    known = list(known)
    if meant := near_misses(name, known, cutoff):
        return f"{name}: did you mean {' or '.join(meant)}?"
    more = f", … ({len(known)} in all)" if len(known) > _MOST_NAMED else ""
    return f"{name}: {has} {', '.join(known[:_MOST_NAMED]) or 'nothing'}{more}"


def _letters(name: str) -> str:
    return "".join(character for character in name.lower() if character.isalnum())


class HelpfulAttributes:
    """Says which attribute was meant by a misspelt one."""

    # Hidden from type checkers, which would otherwise let every attribute pass.
    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> object:
            kind = type(self).__name__
            if name.startswith("_"):
                raise AttributeError(f"{kind} has no attribute {name}")
            public = [other for other in dir(self) if not other.startswith("_")]
            raise AttributeError(f"{kind} has no attribute {unknown(name, public, 'it has')}")
