"""The programs of the package, and calls of them."""

from __future__ import annotations

import functools
import importlib.metadata
import json
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cardiotwin._errors import FileError, from_exit

Argument = str | os.PathLike[str] | float | int


def version() -> str:
    """Version of the package, which is that of its programs."""
    return importlib.metadata.version("cardiotwin")


@functools.cache
def program() -> Path:
    """Path of `cardiotwin`: that of this package, or else the first in PATH."""
    for file in importlib.metadata.files("cardiotwin") or []:
        if file.name == "cardiotwin" and file.parent.name in ("bin", "Scripts"):
            path = Path(os.fspath(file.locate())).resolve()
            if path.is_file():
                return path
    found = shutil.which("cardiotwin")
    if found is None:
        raise FileError("no program `cardiotwin` in the package or in PATH: install the wheel, or add it to PATH")
    return Path(found)


def command(arguments: Sequence[Argument]) -> list[str]:
    """A command line of `cardiotwin` without colour."""
    return [
        str(program()),
        "--color",
        "never",
        *(os.fspath(a) if isinstance(a, os.PathLike) else str(a) for a in arguments),
    ]


def call(*arguments: Argument, accept: Sequence[int] = (0,)) -> str:
    """Calls `cardiotwin` and returns its standard output. An exit code that is not in `accept` raises a
    subclass of `cardiotwin.Error` with the program's words."""
    done = subprocess.run(
        command(arguments), stdin=subprocess.DEVNULL, capture_output=True, text=True, encoding="utf-8", check=False
    )
    if done.returncode not in accept:
        raise from_exit(done.returncode, done.stderr or done.stdout)
    return done.stdout


def call_json(*arguments: Argument, accept: Sequence[int] = (0,)) -> dict[str, Any]:
    """As `call`, for a command whose standard output is one JSON object."""
    answer: dict[str, Any] = json.loads(call(*arguments, accept=accept))
    return answer
