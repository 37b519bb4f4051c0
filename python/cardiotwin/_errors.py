"""Exceptions: one for each exit code of the programs, with the words that they print."""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from cardiotwin._native import Error, ModelError


class ProblemsError(Error):
    """Exit code 1: problems were found; patients failed, were cancelled or refused."""


class UsageError(Error):
    """Exit code 2: an argument is invalid."""


class InputError(Error):
    """Exit code 3: `cohort.toml`, settings or measurements are wrong, or no patient is sound; nothing was run."""


class LockedError(Error):
    """Exit code 4: another coordinator works on this run."""


class StoreError(Error):
    """Exit code 5: the run's database is missing, damaged, of a newer version, or cannot be written. Also
    raised for results that the run does not have."""


class FileError(Error):
    """Exit code 6: a file, a directory or a program cannot be used."""


class UnfinishedError(Error):
    """Exit code 8: jobs are pending or running on a cluster."""


class BugError(Error):
    """Exit code 70, or a signal: a defect of cardiotwin."""


class InterruptedRun(Error):
    """Exit code 130: stopped by Ctrl-C or SIGTERM; the same call continues."""


class UnknownNameError(Error, KeyError):
    """A patient, biomarker, parameter or trace of this name does not exist. The words say what was
    probably meant."""

    # A KeyError shows its words in quotes.
    __str__ = Exception.__str__


class MissingExtraError(Error, ImportError):
    """An optional package is not installed. The words name the extra to install."""


_BY_CODE: dict[int, type[Error]] = {
    1: ProblemsError,
    2: UsageError,
    3: InputError,
    4: LockedError,
    5: StoreError,
    6: FileError,
    7: ProblemsError,
    8: UnfinishedError,
    130: InterruptedRun,
}


def from_exit(code: int, words: str) -> Error:
    """The exception of an exit code, with the program's words."""
    kind = _BY_CODE.get(code, BugError)
    return kind(words.strip().removeprefix("error: ") or f"cardiotwin ended with exit code {code}")


@contextmanager
def without_folder(folder: Path) -> Generator[None]:
    """Leaves a temporary folder out of the words of errors, where it would mislead."""
    try:
        yield
    except Error as error:
        raise type(error)(str(error).replace(f"{folder}{os.sep}", "")) from None


__all__ = [
    "BugError",
    "Error",
    "FileError",
    "InputError",
    "InterruptedRun",
    "LockedError",
    "MissingExtraError",
    "ModelError",
    "ProblemsError",
    "StoreError",
    "UnfinishedError",
    "UnknownNameError",
    "UsageError",
    "from_exit",
    "without_folder",
]
