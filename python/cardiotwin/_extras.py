"""Packages that are installed only by those who want them."""

from __future__ import annotations

from types import TracebackType

from cardiotwin._errors import MissingExtraError


class needs:
    """A block that imports an optional package: without it, the error names the extra to install."""

    def __init__(self, package: str) -> None:
        self._package = package

    def __enter__(self) -> None:
        return None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] == self._package:
            raise MissingExtraError(
                f"{self._package} is not installed: pip install 'cardiotwin[{self._package}]'"
            ) from error
