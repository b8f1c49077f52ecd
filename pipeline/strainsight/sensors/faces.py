"""Faces of a surface, as a designer would select them, found in the facets of a mesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from strainsight.columns import Column
from strainsight.errors import UserError
from strainsight.mesh.coincident import component_labels
from strainsight.mesh.facets import Facets, by_kind
from strainsight.mesh.kinds import FACETS
from strainsight.ordering import index_of_largest, tied_order
from strainsight.sensors.edges import edges_of
from strainsight.sensors.surface import angle_between, facet_centres
from strainsight.sensors.surface_paths import Skin, locate, skin_of

LEVEL = np.deg2rad(1.0)
"""Largest angle between normals of neighbouring facets in one plane."""
BENT = np.deg2rad(5.0)
"""Largest angle between a normal and the mean normal of a flat face."""
CORNERS = np.array([kind.corners for kind in FACETS])
Vector = tuple[float, float, float]
ROUND = 0.02
"""Largest distance of a node from a cylinder, as a share of its radius."""
TILTED = 0.25
"""Largest ratio of the RMS of the axial and radial components of the normals of a cylinder."""
LARGEST = 1e3
"""Largest radius of a cylinder over the size of its face; a larger one cannot be distinguished from a plane by its nodes."""


@dataclass(frozen=True)
class Pick:
    """Selection of a face; all specified criteria must hold.

    near: points [m], the face nearest to each of them; normal (3,) and angle [deg]: facets whose outward normal is within this
    angle of it; box [m]: facets whose centre lies between its lower and upper corner; radius [m]: facets of cylinders of this
    radius."""

    near: tuple[Vector, ...] = ()
    normal: Vector | None = None
    angle: float = 10.0
    box: tuple[Vector, Vector] | None = None
    radius: float | None = None


@dataclass(frozen=True)
class Faces:
    """The f exterior facets as n faces, the largest first.

    point: the centre of the facet nearest to the centre of the face, rounded to a millionth of the size of the facet; of (f,):
    the face of each facet, which is not written to files."""

    area: Annotated[np.ndarray, Column("m^2", "face", "area of every face, largest first")]
    centre: Annotated[np.ndarray, Column("m", "face × 3", "centroid of every face, global axes")]
    normal: Annotated[
        np.ndarray, Column("1", "face × 3", "outward normal of every flat face, global axes; zero: curved face")
    ]
    radius: Annotated[np.ndarray, Column("m", "face", "radius of every cylindrical face; zero: other face")]
    axis: Annotated[
        np.ndarray, Column("1", "face × 3", "axis of every cylindrical face, global axes; zero: other face")
    ]
    hollow: Annotated[np.ndarray, Column("1", "face", "1 if the face is a bore")]
    point: Annotated[np.ndarray, Column("m", "face × 3", "a point on every face, global axes")]
    of: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def near(self, face: int) -> str:
        """Its point, as in a config: "[x, y, z]"."""
        return "[" + ", ".join(f"{x:.12g}" for x in self.point[face] + 0.0) + "]"

    def in_words(self, face: int) -> str:
        """Type of the face, with its dimensions."""
        if self.normal[face].any():
            return "flat, normal ({:.3g}, {:.3g}, {:.3g})".format(*(self.normal[face].round(6) + 0.0))
        if self.radius[face]:
            what = "bore" if self.hollow[face] else "cylinder"
            axis = "({:.3g}, {:.3g}, {:.3g})".format(*(self.axis[face].round(6) + 0.0))
            return f"{what}, radius {self.radius[face]:.4g} m, axis {axis}"
        return "curved"


def faces_of(position: np.ndarray, facets: Facets) -> Faces:
    """The faces of a surface; position (n, 3) [m].

    A flat face consists of neighbours with equal normals (to 1° each, 5° in total), if it has a node inside; a strip of a
    cylinder is flat too, but has none. The other facets are joined across edges of less than 30°, and form a cylinder if their
    nodes lie on one."""
    vector = facet_vectors(position, facets)
    edges = edges_of(position, facets)
    first = edges.start[(edges.count == 2) & ~edges.sharp]
    left, right = edges.facet[first], edges.facet[first + 1]
    level = angle_between(vector[left], vector[right]) < LEVEL
    plane = _join(len(vector), left[level], right[level])
    flat = _has_a_node_inside(plane, facets) & ~_is_bent(plane, vector)
    at_plane_face = flat[plane[left]] | flat[plane[right]]
    smooth = np.where(at_plane_face, plane[left] == plane[right], True)
    return _describe_faces(_join(len(vector), left[smooth], right[smooth]), position, facets, vector)


def picked(pick: Pick, faces: Faces, position: np.ndarray, facets: Facets) -> np.ndarray:
    """Indices (k,) of the selected facets, ascending; position (n, 3) [m].

    Raises UserError if no facet is selected, if a point is farther from the surface than the part is long, and if it is equally
    near to two faces that the other criteria do not distinguish."""
    centre, normal = facet_centres(position, facets.kind, facets.nodes)
    selected = np.ones(len(faces.of), dtype=bool)
    if pick.normal is not None:
        axis = np.asarray(pick.normal, dtype=float)
        selected &= angle_between(normal, np.tile(axis, (len(normal), 1))) <= np.deg2rad(pick.angle)
        selected &= normal.any(axis=1)
    if pick.box is not None:
        selected &= np.all((centre >= pick.box[0]) & (centre <= pick.box[1]), axis=1)
    if pick.radius is not None:
        has_radius = np.abs(faces.radius - pick.radius) <= ROUND * pick.radius
        selected &= has_radius[faces.of]
        if not has_radius.any():
            radii = sorted({f"{r:.4g}" for r in faces.radius[faces.radius > 0]}, key=float)
            known = (
                f"Use one of the radii {', '.join(radii[:8])} m."
                if radii
                else "Remove `radius`: this surface has no cylindrical faces."
            )
            raise UserError(f"no face has a radius of {pick.radius:g} m", remedy=known)
    if pick.near:
        skin, likely = skin_of(position, facets), faces.of[selected]
        selected &= np.isin(faces.of, [_nearest(np.asarray(point), faces, skin, likely) for point in pick.near])
    if not selected.any():
        picks = [name for name in ("near", "normal", "box", "radius") if getattr(pick, name)]
        where = (
            f"Relax {' or '.join(f'`{name}`' for name in picks)}: no facet meets all of these criteria"
            if len(picks) > 1
            else "Check that lengths are in m"
        )
        raise UserError(
            "no facet of the surface is selected", remedy=f"{where}. `strainsight init` lists the faces of a deck."
        )
    return np.flatnonzero(selected)


def pointed_at(face: int, faces: Faces, position: np.ndarray, facets: Facets) -> str:
    """Entry of `mesh.faces` that selects a flat face: "near: [x, y, z]", with its normal if another face touches it there."""
    point = faces.near(face)
    try:
        picked(Pick(near=(tuple(faces.point[face].tolist()),)), faces, position, facets)
    except UserError:
        return f"near: {point}, normal: [" + ", ".join(f"{x:.6g}" for x in faces.normal[face].round(6) + 0.0) + "]"
    return f"near: {point}"


def _nearest(point: np.ndarray, faces: Faces, skin: Skin, likely: np.ndarray) -> int:
    """The face nearest to a point (3,) [m]; of two equally near, such as parts in contact, the one among the likely ones."""
    long = float(np.linalg.norm(np.ptp(skin.position, axis=0)))
    hit = locate(skin, point[None])
    face, distance = int(faces.of[hit.facet[0]]), float(hit.distance[0])
    where = "({:g}, {:g}, {:g}) m".format(*point)
    if distance > long:
        raise UserError(
            f"the point {where} is {distance:.4g} m away from a part that is only {long:.4g} m long",
            remedy="Specify coordinates in m, whatever the unit of the deck.",
        )
    if (others := faces.of != face).any():
        rest = locate(skin_of(skin.position, skin.facets.some(others)), point[None])
        other = int(faces.of[others][rest.facet[0]])
        if rest.distance[0] - distance <= 1e-6 * long:
            if (other in likely) != (face in likely):
                return other if other in likely else face
            raise UserError(
                f"the point {where} is equally near to two faces: {faces.in_words(face)} and {faces.in_words(other)}",
                remedy="Specify a point inside the intended face, or add the key `normal` with the normal of this face.",
            )
    return face


def facet_vectors(position: np.ndarray, facets: Facets) -> np.ndarray:
    """Area times outward normal (f, 3) [m²] of the polygon of every facet's corners, ½ Σ xₐ × xᵦ; position (n, 3) [m]."""
    vector = np.zeros((len(facets.kind), 3))
    for kind, which, nodes in by_kind(facets.kind, facets.nodes):
        x = position[nodes[:, : kind.corners]]
        last = x[:, -1] if kind.corners == 4 else x[:, 0]
        one, two = (x[:, 2] - x[:, 0], last - x[:, 1]) if kind.corners == 4 else (x[:, 1] - last, x[:, 2] - last)
        vector[which] = 0.5 * np.cross(one, two)
    return vector


def _join(count: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Number (count,) of the group of each item, with pairs a and b (m,) in one group; groups in the order of their first."""
    _, first, member = np.unique(component_labels(count, a, b), return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[member])


def _has_a_node_inside(group: np.ndarray, facets: Facets) -> np.ndarray:
    """Whether a corner belongs only to facets of the group (n,)."""
    corner, groups = [], []
    for kind, which, _ in by_kind(facets.kind, facets.nodes):
        corner.append(facets.corners[which, : kind.corners].ravel())
        groups.append(np.repeat(group[which], kind.corners))
    node, of = np.concatenate(corner), np.concatenate(groups)
    low, high = np.full(node.max() + 1, len(group)), np.full(node.max() + 1, -1)
    np.minimum.at(low, node, of)
    np.maximum.at(high, node, of)
    inside = np.zeros(group.max() + 1, dtype=bool)
    inside[low[(low == high) & (high >= 0)]] = True
    return inside


def _is_bent(group: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Whether a facet normal differs from the mean of its group by more than `BENT`: (n,) bool."""
    mean = np.zeros((group.max() + 1, 3))
    np.add.at(mean, group, vector)
    bent = np.zeros(len(mean), dtype=bool)
    np.logical_or.at(bent, group, angle_between(vector, mean[group]) > BENT)
    return bent


def _describe_faces(group: np.ndarray, position: np.ndarray, facets: Facets, vector: np.ndarray) -> Faces:
    size, count = np.linalg.norm(vector, axis=1), int(group.max()) + 1
    middle, _ = facet_centres(position, facets.kind, facets.nodes)
    area, total, moment = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3))
    np.add.at(area, group, size)
    np.add.at(total, group, vector)
    np.add.at(moment, group, size[:, None] * middle)
    order = tied_order(-area)
    of = np.argsort(order)[group]
    area, total = area[order], total[order]
    centre = moment[order] / np.where(area > 0, area, 1.0)[:, None]
    bent = _is_bent(group, vector)[order]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    normal = np.where(bent[:, None] | (length == 0), 0.0, total / np.where(length > 0, length, 1.0))
    radius, axis, hollow = np.zeros(count), np.zeros((count, 3)), np.zeros(count, dtype=bool)
    point = np.zeros((count, 3))
    corner = np.where(np.arange(4) < CORNERS[facets.kind][:, None], facets.nodes[:, :4], -1)
    for face, members in enumerate(np.split(np.argsort(of, kind="stable"), np.cumsum(np.bincount(of))[:-1])):
        first = members[index_of_largest(-np.linalg.norm(middle[members] - centre[face], axis=1))]
        point[face] = middle[first].round(int(np.ceil(6 - 0.5 * np.log10(max(size[first], 1e-24)))))
        if bent[face]:
            nodes = np.unique(corner[members])
            on_it = position[nodes[nodes >= 0]]
            radius[face], axis[face], hollow[face] = cylinder(on_it, middle[members], vector[members])
    return Faces(area, centre, normal, radius, axis, hollow, point, of)


def cylinder(x: np.ndarray, middle: np.ndarray, vector: np.ndarray) -> tuple[float, np.ndarray, bool]:
    """Radius [m], axis (3,) and whether it is a bore, of the cylinder through the points x (k, 3) [m].

    The start is the axis perpendicular to the normals and the circle of least squares, |x|² = 2 c·x + R² − |c|². It is then
    fitted to the points, because the normals of flat facets on a coarse cylinder are inclined to it. Zero if a point is off by
    more than 2 % of the radius. middle (m, 3) [m] and vector (m, 3) [m²] of its facets."""
    none = (0.0, np.zeros(3), False)
    _, s, V = np.linalg.svd(vector / np.linalg.norm(vector, axis=1, keepdims=True).clip(1e-300), full_matrices=False)
    if len(s) < 3 or s[2] > TILTED * s[0]:
        return none
    origin, size = x.mean(axis=0), float(np.ptp(x, axis=0).max())
    y = (x - origin) / size
    flat = y @ V[:2].T
    solution, _, rank, _ = np.linalg.lstsq(np.c_[2 * flat, np.ones(len(flat))], np.sum(flat**2, axis=1), rcond=1e-6)
    if rank < 3:
        return none

    def off(p: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(_frame(p, V, y)[1], axis=1) - p[4])

    radius = np.sqrt(solution[2] + solution[:2] @ solution[:2])
    from scipy.optimize import least_squares

    fitted = least_squares(off, [0.0, 0.0, *solution[:2], radius], x_scale=0.1, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    radius = float(fitted.x[4])
    if not 0 < radius < LARGEST or np.abs(fitted.fun).max() > ROUND * radius:
        return none
    axis, out = _frame(fitted.x, V, (middle - origin) / size)
    return radius * size, axis * np.sign(axis[index_of_largest(np.abs(axis))]), bool(np.sum(out * vector) < 0)


def _frame(p: np.ndarray, V: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axis (3,) along V₃ + p₀ V₁ + p₁ V₂ through p₂ V₁ + p₃ V₂, and vectors from it to the points y (k, 3)."""
    axis = V[2] + p[:2] @ V[:2]
    axis /= np.linalg.norm(axis)
    arm = y - p[2:4] @ V[:2]
    return axis, arm - np.outer(arm @ axis, axis)
