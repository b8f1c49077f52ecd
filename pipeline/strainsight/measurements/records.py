"""What a file of test data holds, as it stands there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from strainsight.errors import UserError


@dataclass(frozen=True)
class Recording:
    """Channels of one file on one clock.

    time (T,) [s], finite, not yet checked for order; channels: name as it was asked for → (T,) in the unit of the file,
    NaN where a sample is missing; units: name → the unit as the file states it, None where it states none.
    source: the file. lines (k, 2): sample from 0 and its line in the file; between two entries every sample stands on the
    next line. Empty where the file has no lines.
    """

    time: np.ndarray
    channels: Mapping[str, np.ndarray]
    units: Mapping[str, str | None]
    source: str
    lines: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))

    def __post_init__(self) -> None:
        for name, values in self.channels.items():
            if values.shape != self.time.shape:
                raise UserError(
                    f"{name!r} has {values.size} samples, the clock {self.time.size}",
                    where=self.source,
                    remedy="give channels of one clock",
                )
        if self.time.size < 2:
            raise UserError(
                f"the record has {self.time.size} samples", where=self.source, remedy="a record needs at least two"
            )

    def place(self, sample: int) -> str:
        """ "file:line" of a sample from 0, or "file, sample 12" (from 1) where the file has no lines."""
        if not len(self.lines):
            return f"{self.source}, sample {sample + 1}"
        run = self.lines[np.searchsorted(self.lines[:, 0], sample, side="right") - 1]
        return f"{self.source}:{run[1] + sample - run[0]}"


def plain(text: str, most: int = 40) -> str:
    """A piece of a file for a message: quoted, cut, and without signs that a terminal would obey."""
    cut = text if len(text) <= most else text[: most - 1] + "…"
    return "'" + "".join(sign if sign.isprintable() else "?" for sign in cut) + "'"


def decoded(line: bytes) -> str:
    """Text in UTF-8, else in the code page 1252 of Windows."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")


def opened(path: Path) -> BinaryIO:
    """The file, open to read its bytes. Raises UserError where it is missing, empty, or no file."""
    try:
        if not path.is_file():
            raise UserError(
                "not a file" if path.exists() else "no such file",
                where=str(path),
                remedy="check the name; a relative path counts from the config file",
            )
        if not path.stat().st_size:
            raise UserError("the file is empty", where=str(path), remedy="export the test data again")
        return path.open("rb")
    except (OSError, ValueError) as error:
        raise UserError(
            f"cannot be read: {error}", where=str(path), remedy="check that it is a readable file"
        ) from None
