"""Gauges that are bonded already, by their coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from strainsight.errors import InfeasibleError, UserError
from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
from strainsight.sensors.candidates import STEEPEST, Arms, Candidates
from strainsight.sensors.points import normals_at
from strainsight.sensors.rows import fits
from strainsight.sensors.surface import turned
from strainsight.sensors.walk import Located, Skin, locate, skin_of
from strainsight.sensors.zones import Zone, inside

ALIKE = 1e-6
"""Of the surface's extent: gauges nearer than this to one another are in one place."""


@dataclass(frozen=True)
class BondedEntry:
    """One gauge: position (3,) [m], direction (3,) of any length, length of its grid [m], angles of its grids [deg] from
    the direction, right-handed about the outward normal (several: a rosette); name, empty: none; key of the config that states
    it, empty: its number below that of all; arms: of a bridge those behind the first, each of one grid, with the sign 1 or −1 of
    their strain; that of the first is 1."""

    position: Sequence[float]
    direction: Sequence[float]
    length: float = 0.0
    angles: Sequence[float] = (0.0,)
    name: str = ""
    key: str = ""
    arms: Sequence[tuple[BondedEntry, int]] = ()


def bonded(
    mesh: Mesh,
    facets: Facets | Skin,
    entries: Sequence[BondedEntry],
    tolerance: float,
    key: str = "gauges.fixed",
) -> tuple[Candidates, np.ndarray]:
    """The gauges at the nearest points of the surface, and how far (entries,) [m] that is from their positions, of a bridge the
    most of its arms:

        d ∥ a − (a·n) n,     turned by each angle about n

    facets of the whole surface; tolerance [m]; key: what to blame, the number of the entry is added to it.
    Raises UserError, with the name of the entry or its number from 1, for one that is farther from the surface than the
    tolerance, whose direction has no length or is within 10° of the normal, whose grid runs over a sharp edge, or that is in the
    place and direction of another. So for each arm of a bridge, but that only arms of one bridge and opposite signs may not be in
    one place and direction.
    """
    arms = [(i, arm, sign) for i, entry in enumerate(entries) for arm, sign in entry.arms]
    n, owner = len(entries), np.array([i for i, _, _ in arms], dtype=np.int64)
    grids, distance = _grids(mesh, facets, [*entries, *(arm for _, arm, _ in arms)], tolerance, key)
    if not arms:
        return grids, distance
    pool, sign = grids.take(grids.channels(np.arange(n))), np.array([float(sign) for _, _, sign in arms])
    grid = grids.take(grids.channels(n + np.arange(len(arms))))
    moved = distance[:n].copy()
    np.maximum.at(moved, owner, distance[n:])
    return replace(pool, arms=Arms(pool.first[owner], sign, grid)), moved


def _grids(
    mesh: Mesh, facets: Facets | Skin, entries: Sequence[BondedEntry], tolerance: float, key: str
) -> tuple[Candidates, np.ndarray]:
    """The entries without regard to their arms, each a gauge, and how far (entries,) [m] each is from its position."""
    skin = facets if isinstance(facets, Skin) else skin_of(mesh.position, facets)
    place = np.array([entry.position for entry in entries], dtype=float).reshape(-1, 3)
    if not np.isfinite(place).all():
        i = int(np.argmin(np.isfinite(place).all(axis=1)))
        raise _refused(key, entries, i, f"has the position {tuple(entries[i].position)}", "give three numbers")
    if not len(entries):
        return _channels(skin, entries, np.zeros(0, int), np.zeros((0, 2)), place, place, place), np.zeros(0)
    found = locate(skin, place)
    beyond = found.distance > tolerance * (1 + 1e-9)
    if beyond.any():
        i = int(np.argmax(beyond))
        raise _refused(
            key,
            entries,
            i,
            f"is {found.distance[i]:.4g} m from the surface (nearest: {_xyz(found.point[i])}), beyond {tolerance:g} m",
            "correct its position, or raise snap_tolerance beside it; positions are in metres",
        )
    normal = normals_at(skin, found.facet, found.local)
    _check_side(mesh, skin, key, entries, place, found)
    d = np.array([_laid(key, entries, i, normal[i]) for i in range(len(entries))])
    _check_apart(key, entries, found.point, d, ALIKE * float(np.ptp(skin.position, axis=0).max()))
    pool = _channels(skin, entries, found.facet, found.local, found.point, normal, d)
    whole = fits(mesh.position, pool, skin)
    if not whole.all():
        i = int(pool.gauge[np.argmin(whole)])
        raise _refused(
            key,
            entries,
            i,
            f"has a grid of {entries[i].length:.3g} m that runs over a sharp edge",
            "correct its position, direction or length",
        )
    return pool, found.distance


def _check_side(
    mesh: Mesh, skin: Skin, key: str, entries: Sequence[BondedEntry], place: np.ndarray, found: Located
) -> None:
    """Refuse a place (entries, 3) [m] in the middle of a shell: the surface has a point as far behind it as in front."""
    shell = np.flatnonzero(skin.facets.of(mesh.shells)[found.facet])
    other = locate(skin, 2 * place[shell] - found.point[shell]) if len(shell) else found
    size = ALIKE * float(np.ptp(skin.position, axis=0).max())
    element = skin.facets.element_id
    for i, facet, distance in zip(shell.tolist(), other.facet, other.distance, strict=False):
        if distance < size and facet != found.facet[i] and element[facet] == element[found.facet[i]]:
            raise _refused(
                key,
                entries,
                i,
                f"is as near to the upper face of shell {element[facet]} as to the lower one",
                f"give a position on the face that it is bonded on, such as {_xyz(found.point[i])}",
            )


def _channels(
    skin: Skin,
    entries: Sequence[BondedEntry],
    facet: np.ndarray,
    local: np.ndarray,
    point: np.ndarray,
    normal: np.ndarray,
    d: np.ndarray,
) -> Candidates:
    each = np.repeat(np.arange(len(entries)), [len(entry.angles) for entry in entries])
    angle = np.array([angle for entry in entries for angle in entry.angles], dtype=float)
    return Candidates(
        **skin.facets.columns(facet[each]),
        position=point[each],
        normal=normal[each],
        direction=turned(d[each], normal[each], angle),
        angle=angle,
        local=local[each],
        length=np.array([entry.length for entry in entries], dtype=float)[each],
        gauge=each,
        bonded=np.ones(len(each), dtype=bool),
    )


def _laid(key: str, entries: Sequence[BondedEntry], i: int, n: np.ndarray) -> np.ndarray:
    entry = entries[i]
    a = np.asarray(entry.direction, dtype=float)
    length = np.linalg.norm(a)
    if a.shape != (3,) or not (np.isfinite(length) and length > 0):
        raise _refused(
            key, entries, i, f"has the direction {tuple(entry.direction)}", "give three numbers, not all zero"
        )
    a = a / length
    t = a - (a @ n) * n
    angle = np.rad2deg(np.arctan2(np.linalg.norm(t), abs(a @ n)))
    if angle < STEEPEST:
        raise _refused(
            key,
            entries,
            i,
            f"has a direction at {angle:.3g}° to the normal {_xyz(n)} of the surface there, and so none on it",
            f"give a direction along the surface, at more than {STEEPEST:g}° to its normal",
        )
    return t / np.linalg.norm(t)


def _check_apart(key: str, entries: Sequence[BondedEntry], point: np.ndarray, d: np.ndarray, near: float) -> None:
    sign = {id(arm): (id(entry), own) for entry in entries for arm, own in entry.arms}
    sign |= {id(entry): (id(entry), 1) for entry in entries if entry.arms}
    for i, j in sorted(cKDTree(point).query_pairs(near)):
        (bridge, first), (other_bridge, second) = (sign.get(id(entries[k]), (0, 0)) for k in (i, j))
        # Two grids side by side are in one place here: arms that add up, or of different bridges.
        if bridge != other_bridge or (bridge and first == second):
            continue
        if abs(d[i] @ d[j]) > np.cos(np.deg2rad(0.1)):
            other = entries[i].name or f"gauge {i + 1}"
            raise _refused(key, entries, j, f"is in the place and direction of {other}", "leave one of them out")


def _refused(key: str, entries: Sequence[BondedEntry], i: int, what: str, remedy: str) -> UserError:
    own = entries[i]
    return UserError(f"bonded gauge {own.name or i + 1} {what}", key=own.key or f"{key}.{i}", remedy=remedy)


def _xyz(x: np.ndarray) -> str:
    return ", ".join(f"{value:.4g}" for value in x)


@dataclass(frozen=True)
class GivenGauges:
    """pool (m): element is the gauge's number in the table, facet 0, nodes −1, normal zero, direction unit or zero where
    the table leaves it blank; rows, CSR (m, r) [1/m, 1/rad]: strain per motion of every row of the matrices."""

    pool: Candidates
    rows: sparse.csr_array


def without(given: GivenGauges, mesh: Mesh, facets: Facets | None, zones: Sequence[Zone]) -> GivenGauges:
    """Those outside all zones. Raises InfeasibleError where none is left."""
    keep = np.ones(len(given.pool), dtype=bool)
    for zone in zones:
        keep &= ~inside(zone, mesh, facets, given.pool.position, given.pool.normal)
    if not keep.any():
        raise InfeasibleError(f"none of the {len(keep)} given gauges is left", remedy="smaller zones to exclude")
    index = np.flatnonzero(keep)
    return GivenGauges(given.pool.take(index), given.rows[index])


def given_pool(number: np.ndarray, position: np.ndarray, direction: np.ndarray) -> Candidates:
    """Candidates by their numbers (m,), positions (m, 3) [m] and directions (m, 3) of any length."""
    m = len(number)
    length = np.linalg.norm(direction, axis=1)
    return Candidates(
        element=number,
        facet=np.zeros(m, dtype=np.int64),
        kind=np.full(m, -1),
        nodes=np.full((m, 8), -1),
        position=position,
        normal=np.zeros((m, 3)),
        direction=direction / np.where(length > 0, length, 1.0)[:, None],
        angle=np.zeros(m),
    )
