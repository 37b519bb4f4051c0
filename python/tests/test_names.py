"""Names: none hides Python's own, a misspelt one is answered with what was meant, and each tells its unit."""

from __future__ import annotations

import builtins
import subprocess
import sys

import cardiotwin
import pytest
from cardiotwin import _names, _native


def test_a_star_import_hides_no_builtin() -> None:
    names: dict[str, object] = {}
    exec("from cardiotwin import *", names)
    own = set(names) - {"__builtins__"}
    assert own == set(cardiotwin.__all__)
    assert not own & set(dir(builtins))


@pytest.mark.parametrize(
    ("asked", "meant"),
    [
        ("Pmax", ["P_max_mmHg"]),
        ("p_max", ["P_max_mmHg"]),
        ("stroke_volume", []),
        ("SVmL", ["SV_mL"]),
        ("dPdt", ["dPdt_max_mmHg_per_ms", "dPdt_min_mmHg_per_ms"]),
        ("EDV_ml", ["EDV_mL"]),
    ],
)
def test_near_misses_of_biomarkers(asked: str, meant: list[str]) -> None:
    known = [row[0] for row in _native.organ_biomarkers()]
    assert _names.near_misses(asked, known) == meant


def test_unknown_names_are_answered() -> None:
    beat = cardiotwin.Ventricle.average().beat()
    for ask in (lambda: beat.biomarkers["Pmax"], lambda: beat.biomarkers.Pmax):
        with pytest.raises((KeyError, AttributeError), match=r"^Pmax: did you mean P_max_mmHg\?$"):
            ask()
    with pytest.raises(cardiotwin.UnknownNameError, match=r"^pressure: did you mean pressure_mmHg\?$"):
        beat.traces["pressure"]
    with pytest.raises(cardiotwin.UnknownNameError, match=r"^zeal: expected one of time_ms, pressure_mmHg"):
        beat.traces["zeal"]
    cells = cardiotwin.cell_beats([[5.0]], ["n_Tm"])
    with pytest.raises(KeyError, match=r"^Sa_max: did you mean Sa_max_kPa\?$"):
        cells["Sa_max"]
    with pytest.raises(AttributeError, match=r"^Beat has no attribute biomakers: did you mean biomarkers\?$"):
        _ = beat.biomakers
    with pytest.raises(AttributeError, match=r"has no attribute Cohrt: did you mean Cohort\?$"):
        _ = cardiotwin.Cohrt


def test_a_long_list_of_names_is_cut() -> None:
    words = _names.unknown("zeal", [f"P{n:03}" for n in range(300)], "the run has")
    assert words.endswith("P019, … (300 in all)") and len(words) < 160


def test_units_in_names_are_those_of_the_vocabulary() -> None:
    rows = [*_native.organ_biomarkers(), *_native.cell_biomarkers()]
    rows += [(name, unit, meaning) for name, unit, meaning, _, _ in _native.cell_parameters()]
    with_units = {name: unit for name, unit, _ in rows if unit}
    assert len(with_units) > 20
    vocabulary = _names._vocabulary
    _names._vocabulary = dict  # Only what the names themselves say.
    try:
        assert {name: _names.unit_of(name) for name in with_units} == with_units
    finally:
        _names._vocabulary = vocabulary
    assert all(_names.unit_of(name) == unit for name, unit, _ in rows)
    assert _names.stem_and_unit("peripheral_resistance_mmHg_s_per_mL") == ("peripheral_resistance", "mmHg·s/mL")
    assert _names.stem_and_unit("exponent") == ("exponent", "")


@pytest.mark.parametrize(
    ("package", "code"),
    [
        ("pandas", "cardiotwin.cell_parameters()"),
        ("pandas", "cardiotwin.Ventricle.average().parameters.series()"),
        ("pandas", "cardiotwin.Ventricle.average().beat().traces.frame()"),
        ("xarray", "cardiotwin.Ventricle.average().beat().traces.dataset()"),
    ],
)
def test_without_an_optional_package_the_error_names_the_extra(package: str, code: str) -> None:
    program = f"import sys; sys.modules[{package!r}] = None; import cardiotwin\n"
    program += "print(cardiotwin.Ventricle.average().beat().biomarkers['SV_mL'] > 10)\n"
    program += f"try:\n    {code}\nexcept ImportError as error:\n    print(type(error).__name__, error)\n"
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert said == f"True\nMissingExtraError {package} is not installed: pip install 'cardiotwin[{package}]'\n"
