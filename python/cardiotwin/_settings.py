"""Settings of the programs as arguments."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, cast

import numpy as np

Setting = str | float | int | bool | Sequence[str] | Sequence[float]
"""A value of ``--set``: a text is passed on as it is, a list becomes an array."""


def assignment(key: str, value: Setting) -> str:
    """``KEY=VALUE`` as the programs read it."""
    return f"{key}={value if isinstance(value, str) else _text(value)}"


def _text(value: Any) -> str:
    if isinstance(value, np.generic | np.ndarray):
        value = cast("Any", value).tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Sequence):
        return f"[{', '.join(_text(one) for one in cast('list[Any]', value))}]"
    return str(value)
