"""Exceptions: one for each exit code of the programs, with the words that they print."""

from __future__ import annotations

from cardiotwin._native import Error, ModelError


class ProblemsError(Error):
    """Exit code 1: problems were found; patients failed, were cancelled or refused."""


class UsageError(Error):
    """Exit code 2: an argument is invalid."""


class InputError(Error):
    """Exit code 3: `cohort.toml` or settings are wrong, or no patient is sound; nothing was run."""


class LockedError(Error):
    """Exit code 4: another coordinator works on this run."""


class StoreError(Error):
    """Exit code 5: the run's database is missing, damaged, of a newer version, or cannot be written."""


class SystemError(Error):
    """Exit code 6: a file, a directory or a program cannot be used."""


class UnfinishedError(Error):
    """Exit code 8: jobs are pending or running on a cluster."""


class BugError(Error):
    """Exit code 70, or a signal: a defect of cardiotwin."""


class InterruptedRun(Error):
    """Exit code 130: stopped by Ctrl-C or SIGTERM; the same call continues."""


_BY_CODE: dict[int, type[Error]] = {
    1: ProblemsError,
    2: UsageError,
    3: InputError,
    4: LockedError,
    5: StoreError,
    6: SystemError,
    8: UnfinishedError,
    130: InterruptedRun,
}


def from_exit(code: int, words: str) -> Error:
    """The exception of an exit code, with the program's words."""
    kind = _BY_CODE.get(code, BugError)
    return kind(words.strip().removeprefix("error: ") or f"cardiotwin ended with exit code {code}")


__all__ = [
    "BugError",
    "Error",
    "InputError",
    "InterruptedRun",
    "LockedError",
    "ModelError",
    "ProblemsError",
    "StoreError",
    "SystemError",
    "UnfinishedError",
    "UsageError",
    "from_exit",
]
