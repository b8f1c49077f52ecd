"""Export of a layout as a universal file (UFF), and edge lines of its part."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.mesh.facets import Facets
from strainsight.sensors.edges import edges_of
from strainsight.sensors.faces import facet_vectors
from strainsight.sensors.surface import farthest_axis

COLOUR = 8
SI, USER_DEFINED = 1, 9
"""Codes of systems of units."""
NOTHING = "NONE"

TITLE, PROGRAM, STAMP = "strain gauge layout", "strainsight", f"{'01-JAN-70':<10}{'00:00:00':<10}"


def uff_text(
    position: np.ndarray,
    direction: np.ndarray,
    normal: np.ndarray,
    labels: Sequence[str],
    *,
    unit: str = "m",
    metres: float = 1.0,
) -> str:
    """A node for each gauge, numbered 1 to k, with a displacement system of the same number that shows its orientation:

        x along the measuring direction, projected on the surface;  z along the outward normal;  y = z × x

    Datasets 151 (header), 164 (units), 2420 (coordinate systems, with the labels as names: rows 1 to 3 of the matrix are
    the axes, row 4 the origin) and 2411 (nodes), as documented by SDRC and the University of Cincinnati.
    position (k, 3) in `unit`, of `metres` metres each; direction (k, 3): if along the normal, x is any tangent; normal (k, 3),
    zero if unknown: then z is any vector perpendicular to x; labels (k,), cut to 80 characters. The file has no date, so that
    equal layouts give equal files."""
    axes = frames(np.asarray(direction, dtype=float), np.asarray(normal, dtype=float))
    header = [TITLE, TITLE, PROGRAM, f"{STAMP}{0:10d}{0:10d}{0:10d}", STAMP, PROGRAM, STAMP]
    code, words = (SI, "SI: Meter (newton)") if unit == "m" else (USER_DEFINED, f"{unit} (newton)")
    # divisors that convert numbers of the file to SI: length, force, temperature
    units = [f"{code:10d}{words:<20}{2:10d}", _numbers([1.0 / metres, 1.0, 1.0]), _numbers([273.15])]
    systems, nodes = [f"{1:10d}", TITLE], []
    for number, (x, frame, label) in enumerate(zip(position, axes, labels, strict=True), start=1):
        systems += [f"{number:10d}{0:10d}{COLOUR:10d}", _name(label), *map(_numbers, [*frame, x])]
        nodes += [f"{number:10d}{0:10d}{number:10d}{COLOUR:10d}", _numbers(x)]
    blocks = ((151, header), (164, units), (2420, systems), (2411, nodes))
    return "".join(_block(number, lines) for number, lines in blocks)


def frames(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Right-handed axes (k, 3, 3), rows x, y, z: z along n, x along d projected on its plane; arbitrary if n is zero or along
    d."""
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
    """The label, changed if it would end the dataset or count as empty."""
    return label if label.strip() not in ("", "-1") else f"{NOTHING} {label}".strip()


def _block(number: int, lines: Sequence[str]) -> str:
    """A dataset with lines in ASCII of at most 80 characters."""
    clean = [line.encode("ascii", "replace").decode()[:80].replace("\n", " ").replace("\r", " ") for line in lines]
    return "\n".join(["    -1", f"{number:6d}", *clean, "    -1"]) + "\n"


LEVEL = 1e-6
"""Cosine below which a facet is viewed edge-on."""


@dataclass(frozen=True)
class EdgeLines:
    """The e edges of a skin, each with both facets: path (e, 3, 3) [m] from end through the middle to end; normal (e, 2, 3) unit,
    of the facets left and right of it, repeated for an edge of one facet; sharp (e,)."""

    path: np.ndarray
    normal: np.ndarray
    sharp: np.ndarray


def edge_lines(position: np.ndarray, facets: Facets) -> EdgeLines:
    """All edges of exterior facets; position (n, 3) [m]."""
    edges = edges_of(position, facets)
    vector = facet_vectors(position, facets)
    size = np.linalg.norm(vector, axis=1, keepdims=True)
    normal = vector / np.where(size > 0, size, 1.0)
    first = edges.start
    second = np.where(edges.count > 1, first + 1, first)
    a, b = (position[edges.ends[first, end]] for end in (0, 1))
    path = np.stack([a, edges.middle[first], b], axis=1)
    return EdgeLines(path, np.stack([normal[edges.facet[first]], normal[edges.facet[second]]], axis=1), edges.sharp)


def seen_from(lines: EdgeLines, toward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges for a viewer in the direction `toward` (3,): visible edges and hidden sharp edges, as segments (s, 2, 3) [m].

    Visible are sharp edges with a facet towards the viewer, or with both facets edge-on, and smooth edges of the contour.
    Occlusion by other parts of the body is not evaluated: for bodies that are not convex some visible edges are in fact hidden.
    """
    facing = lines.normal @ toward
    front, back = facing.max(axis=1), facing.min(axis=1)
    behind = (front <= LEVEL) & (back < -LEVEL)
    turning = (front > LEVEL) & (back <= LEVEL)
    visible = np.where(lines.sharp, ~behind, turning)
    return _segments(lines.path[visible]), _segments(lines.path[lines.sharp & behind])


def _segments(path: np.ndarray) -> np.ndarray:
    return np.concatenate([path[:, :2], path[:, 1:]])
