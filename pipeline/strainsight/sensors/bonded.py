"""Gauges that are bonded already, by their coordinates, and candidate bridges by a pattern of arms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from strainsight.errors import InfeasibleError, UserError
from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.unjoined import component_labels
from strainsight.sensors.access import opposite
from strainsight.sensors.candidates import STEEPEST, Arms, Candidates, concatenate
from strainsight.sensors.rows import fits
from strainsight.sensors.surface import tangent, turned
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
    skin, refuse = (
        facets if isinstance(facets, Skin) else skin_of(mesh.position, facets),
        partial(_refused, key, entries),
    )
    place = np.array([entry.position for entry in entries], dtype=float).reshape(-1, 3)
    if not np.isfinite(place).all():
        i = int(np.argmin(np.isfinite(place).all(axis=1)))
        raise refuse(i, f"has the position {tuple(entries[i].position)}", "give three numbers")
    if not len(entries):
        return _channels(skin, entries, np.zeros(0, int), np.zeros((0, 2)), place, place, place), np.zeros(0)
    found = locate(skin, place)
    beyond = found.distance > tolerance * (1 + 1e-9)
    if beyond.any():
        i = int(np.argmax(beyond))
        raise refuse(
            i,
            f"is {found.distance[i]:.4g} m from the surface (nearest: {_xyz(found.point[i])}), beyond {tolerance:g} m",
            "correct its position, or raise snap_tolerance beside it; positions are in metres",
        )
    _, normal = skin.frames(found.facet, found.local)
    _check_side(mesh, skin, place, found, refuse)
    d = np.array([_tangent(entry.direction, normal[i], partial(refuse, i)) for i, entry in enumerate(entries)])
    _check_apart(entries, found.point, d, ALIKE * float(np.ptp(skin.position, axis=0).max()), refuse)
    pool = _channels(skin, entries, found.facet, found.local, found.point, normal, d)
    whole = fits(mesh.position, pool, skin)
    if not whole.all():
        i = int(pool.gauge[np.argmin(whole)])
        raise refuse(
            i,
            f"has a grid of {entries[i].length:.3g} m that runs over a sharp edge",
            "correct its position, direction or length",
        )
    return pool, found.distance


Refusal = Callable[[int, str, str], UserError]
"""Number of the entry, what is wrong with it, the remedy → the error."""


def _check_side(mesh: Mesh, skin: Skin, place: np.ndarray, found: Located, refuse: Refusal) -> None:
    """Refuse a place (entries, 3) [m] in the middle of a shell: the surface has a point as far behind it as in front."""
    shell = np.flatnonzero(skin.facets.of(mesh.shells)[found.facet])
    other = locate(skin, 2 * place[shell] - found.point[shell]) if len(shell) else found
    size = ALIKE * float(np.ptp(skin.position, axis=0).max())
    element = skin.facets.element_id
    for i, facet, distance in zip(shell.tolist(), other.facet, other.distance, strict=False):
        if distance < size and facet != found.facet[i] and element[facet] == element[found.facet[i]]:
            raise refuse(
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


def _tangent(direction: Sequence[float], n: np.ndarray, refuse: Callable[[str, str], UserError]) -> np.ndarray:
    """A direction (3,) projected on the surface of normal n (3,), of length 1."""
    a = np.asarray(direction, dtype=float)
    length = np.linalg.norm(a)
    if a.shape != (3,) or not (np.isfinite(length) and length > 0):
        raise refuse(f"has the direction {tuple(direction)}", "give three numbers, not all zero")
    a = a / length
    t = a - (a @ n) * n
    angle = np.rad2deg(np.arctan2(np.linalg.norm(t), abs(a @ n)))
    if angle < STEEPEST:
        raise refuse(
            f"has a direction at {angle:.3g}° to the normal {_xyz(n)} of the surface there, and so none on it",
            f"give a direction along the surface, at more than {STEEPEST:g}° to its normal",
        )
    return t / np.linalg.norm(t)


def _check_apart(
    entries: Sequence[BondedEntry], point: np.ndarray, d: np.ndarray, near: float, refuse: Refusal
) -> None:
    sign = {id(arm): (id(entry), own) for entry in entries for arm, own in entry.arms}
    sign |= {id(entry): (id(entry), 1) for entry in entries if entry.arms}
    for i, j in sorted(cKDTree(point).query_pairs(near)):
        (bridge, first), (other_bridge, second) = (sign.get(id(entries[k]), (0, 0)) for k in (i, j))
        # Two grids side by side are in one place here: arms that add up, or of different bridges.
        if bridge != other_bridge or (bridge and first == second):
            continue
        if abs(d[i] @ d[j]) > np.cos(np.deg2rad(0.1)):
            other = entries[i].name or f"gauge {i + 1}"
            raise refuse(j, f"is in the place and direction of {other}", "leave one of them out")


def _refused(key: str, entries: Sequence[BondedEntry], i: int, what: str, remedy: str) -> UserError:
    entry = entries[i]
    return UserError(f"bonded gauge {entry.name or i + 1} {what}", key=entry.key or f"{key}.{i}", remedy=remedy)


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


HERE, BEHIND = 0, 1
PATTERNS: Mapping[str, tuple[tuple[int, float, int], ...]] = {
    "half-bending": ((HERE, 0.0, 1), (BEHIND, 0.0, -1)),
    "full-bending": ((HERE, 0.0, 1), (BEHIND, 0.0, -1), (HERE, 0.0, 1), (BEHIND, 0.0, -1)),
    "half-axial": ((HERE, 0.0, 1), (BEHIND, 0.0, 1)),
    "full-torsion": ((HERE, 45.0, 1), (HERE, -45.0, -1), (BEHIND, 45.0, 1), (BEHIND, -45.0, -1)),
}
"""Arms of each pattern: the side that it is on, its angle [deg] from d, right-handed about the outward normal of its side, sign.
The sign of the first is 1."""
ASKEW = 0.1
"""Degrees by which the directions of one bridge seen from its two sides may differ."""


@dataclass(frozen=True)
class StrainGauges:
    """candidates; alone: places without a bridge, as no facet behind them takes its arms; twice: bridges that were another one,
    seen from its other side; left_out: places where a grid would run over a sharp edge."""

    candidates: Candidates
    alone: int = 0
    twice: int = 0
    left_out: int = 0


def bridges(skin: Skin, pool: Candidates, pattern: str, admitted: np.ndarray) -> StrainGauges:
    """A bridge for every gauge of the pool, with arms at its place p and at the opposite one p′, the first exit of the line from
    p along −n:

        half-bending    ε(p) − ε(p′)            full-bending    2 [ε(p) − ε(p′)], of four grids
        half-axial      ε(p) + ε(p′)            full-torsion    ε₊₄₅(p) − ε₋₄₅(p) + ε₊₄₅(p′) − ε₋₄₅(p′)

    along d at p and d′ ∥ d − (d·n′) n′ at p′, ±45° right-handed about the outward normal of each place.
    pool: gauges of one channel; admitted: indices of the facets that may carry gauges. Left out are bridges whose p′ lies on none
    of these or where d is within 10° of the normal, and of bridges that are one the later ones. All may be.
    """
    found = opposite(skin, pool.position, pool.normal)
    well = np.isin(found.facet, admitted)
    normal = np.zeros((len(pool), 3))
    _, normal[well] = skin.frames(found.facet[well], found.local[well])
    steep = np.abs(np.sum(pool.direction * normal, axis=1)) > np.cos(np.deg2rad(STEEPEST))
    index = np.flatnonzero(well & ~steep)
    own, at, n = pool.take(index), found.facet[index], normal[index]
    behind = replace(
        own,
        **skin.facets.columns(at),
        position=found.point[index],
        normal=n,
        direction=tangent(own.direction, n),
        angle=-own.angle,
        local=found.local[index],
    )
    near = ALIKE * float(np.ptp(skin.position, axis=0).max())
    kept = _once(own, behind, near, quarter=any(turn for _, turn, _ in PATTERNS[pattern]))
    sides = own.take(kept), behind.take(kept)
    (_, first, _), *further = PATTERNS[pattern]
    # By bridge, and within one by arm.
    each, m = np.repeat(np.arange(len(kept)), len(further)), len(kept)
    arms = [_turned(sides[side], turn) for side, turn, _ in further]
    order = np.arange(len(arms) * m).reshape(len(arms), m).T.ravel()
    grid = replace(concatenate(arms), gauge=np.arange(len(order))).take(order)
    sign = np.tile([float(sign) for _, _, sign in further], m)
    made = replace(_turned(sides[HERE], first), arms=Arms(each, sign, grid)) if m else sides[HERE]
    return StrainGauges(made, len(pool) - len(index), len(index) - len(kept))


def _once(one: Candidates, other: Candidates, near: float, quarter: bool) -> np.ndarray:
    """Which of bridges (k,) with their two sides are not an earlier one: the same two places, either way round, and the same
    direction up to sign; quarter: or one across it, which turns signs of ±45° alone."""
    if not len(one):
        return np.zeros(0, dtype=np.int64)
    tree = cKDTree(one.position)
    pairs = []
    for there, back in ((other.position, True), (one.position, False)):
        found = tree.query_ball_point(there, near)
        i = np.repeat(np.arange(len(one)), [len(own) for own in found])
        j = np.array([int(own) for near_ones in found for own in near_ones], dtype=np.int64)
        returns = np.linalg.norm(other.position[j] - (one if back else other).position[i], axis=1) <= near
        # A direction is compared on the side where both are tangent.
        d = (other if back else one).direction[i]
        along = np.linalg.norm(np.cross(d, one.direction[j]), axis=1) < np.sin(np.deg2rad(ASKEW))
        across = np.abs(np.sum(d * one.direction[j], axis=1)) < np.sin(np.deg2rad(ASKEW))
        alike = returns & (along | (across & quarter)) & (i != j)
        pairs.append(np.column_stack([i[alike], j[alike]]))
    i, j = np.concatenate(pairs).T
    return np.sort(np.unique(component_labels(len(one), i, j), return_index=True)[1])


def _turned(side: Candidates, angle: float) -> Candidates:
    if angle == 0:
        return side
    each = np.full(len(side), angle)
    return replace(side, direction=turned(side.direction, side.normal, each), angle=side.angle + angle)
