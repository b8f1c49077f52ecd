"""A layout as a universal file (UFF), which programs for tests and for finite elements read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from strainsight.sensors.surface import farthest_axis

COLOUR = 8
SI, USER_DEFINED = 1, 9
"""Codes of systems of units."""
NOTHING = "NONE"


def uff_text(
    position: np.ndarray,
    direction: np.ndarray,
    normal: np.ndarray,
    labels: Sequence[str],
    *,
    title: str = "strain gauge layout",
    program: str = "strainsight",
    date: str = "01-JAN-70",
    time: str = "00:00:00",
    unit: str = "m",
    metres: float = 1.0,
) -> str:
    """A node for each gauge, numbered 1 to k, whose displacement system of the same number shows how it is bonded:

        x along the measuring direction, laid on the surface;  z along the outward normal;  y = z × x

    Datasets 151 (header), 164 (units), 2420 (coordinate systems, with the labels as names: rows 1 to 3 of the matrix are
    the axes, row 4 the origin) and 2411 (nodes), as SDRC and the University of Cincinnati describe them.
    position (k, 3) in `unit`, of which one is so many metres; direction (k, 3), where it is along the normal x is any tangent;
    normal (k, 3), zero where unknown: then z is any vector across x; labels (k,), cut to 80
    characters; date DD-MMM-YY and time HH:MM:SS of the file.
    """
    axes = frames(np.asarray(direction, dtype=float), np.asarray(normal, dtype=float))
    stamp = f"{date:<10.10}{time:<10.10}"
    header = [title, title, program, f"{stamp}{0:10d}{0:10d}{0:10d}", stamp, program, stamp]
    code, said = (SI, "SI: Meter (newton)") if unit == "m" else (USER_DEFINED, f"{unit} (newton)")
    # What a number of the file is divided by to give SI: length, force, temperature.
    units = [f"{code:10d}{said:<20}{2:10d}", _numbers([1.0 / metres, 1.0, 1.0]), _numbers([273.15])]
    systems, nodes = [f"{1:10d}", title], []
    for number, (x, frame, label) in enumerate(zip(position, axes, labels, strict=True), start=1):
        systems += [f"{number:10d}{0:10d}{COLOUR:10d}", _name(label), *map(_numbers, [*frame, x])]
        nodes += [f"{number:10d}{0:10d}{number:10d}{COLOUR:10d}", _numbers(x)]
    blocks = ((151, header), (164, units), (2420, systems), (2411, nodes))
    return "".join(_block(number, lines) for number, lines in blocks)


def frames(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Right-handed axes (k, 3, 3), rows x, y, z: z along n, x along d laid on its plane; where n is zero or along d, any."""
    frame = np.zeros((len(direction), 3, 3))
    for i, (d, n) in enumerate(zip(direction, normal, strict=True)):
        z = n if np.linalg.norm(n) > 0 else np.cross(d, farthest_axis(d))
        z = z / np.linalg.norm(z) if np.linalg.norm(z) > 0 else np.array([0.0, 0.0, 1.0])
        x = d - (d @ z) * z
        if np.linalg.norm(x) <= 1e-6 * np.linalg.norm(d) or not np.any(d):
            x = farthest_axis(z) - (farthest_axis(z) @ z) * z
        x = x / np.linalg.norm(x)
        frame[i] = x, np.cross(z, x), z
    return frame


def _numbers(values: Iterable[float]) -> str:
    return "".join(f"{value:25.16E}".replace("E", "D") for value in values)


def _name(label: str) -> str:
    """The label, but never a line that would end the dataset or read as none."""
    return label if label.strip() not in ("", "-1") else f"{NOTHING} {label}".strip()


def _block(number: int, lines: Sequence[str]) -> str:
    """Every line in ASCII, at most 80 characters."""
    clean = [line.encode("ascii", "replace").decode()[:80].replace("\n", " ").replace("\r", " ") for line in lines]
    return "\n".join(["    -1", f"{number:6d}", *clean, "    -1"]) + "\n"
