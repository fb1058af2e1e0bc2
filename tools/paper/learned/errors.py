"""Errors that a user can act upon. Each names the file, or the value, that it is about."""

from __future__ import annotations

from pathlib import Path


class PaperError(Exception):
    """What these tools raise; the entry script prints it without a traceback."""


class FileError(PaperError):
    """A file is missing, cannot be read, or does not hold what it should."""

    def __init__(self, path: Path | str, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = Path(path)
        self.reason = reason


class ArgumentError(PaperError):
    """A value that was given is out of range, or two do not go together."""


class StreamError(PaperError):
    """A bit stream is cut short or not one of ours."""
