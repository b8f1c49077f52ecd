"""Joints: relations held at zero."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from strainsight.multibody import relations
from strainsight.multibody.drives import DrivenRelation
from strainsight.multibody.frames import Frame
from strainsight.multibody.relations import Relation, cosine, distance_squared, dot, offset


@dataclass(frozen=True)
class Joint:
    """φ(q) = 0 (1.2) for every relation, φ(q, p(t)) = 0 for one that is driven; any tuple of relations makes a joint.

    aligned: cosines of axes that the relations keep parallel; that they point the same way only the start can say.
    """

    name: str
    relations: tuple[Relation | DrivenRelation, ...]
    aligned: tuple[Relation, ...] = ()


def spherical(name: str, i: Frame, j: Frame) -> Joint:
    """p_i = p_j: three relations."""
    return coincidence(name, i, j, "xyz")


def fixed(name: str, i: Frame, j: Frame) -> Joint:
    """p_i = p_j and parallel axes: six relations."""
    held = (*revolute(name, i, j).relations, dot(i, 0, j, 1))
    return Joint(name, held, tuple(cosine(i, k, j, k) for k in range(3)))


def revolute(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """p_i = p_j, and the axis of j stays along that of i: five relations."""
    i, j = i.turned(axis), j.turned(axis)
    return Joint(name, (*spherical(name, i, j).relations, dot(i, 0, j, 2), dot(i, 1, j, 2)), (cosine(i, 2, j, 2),))


def pin(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """j on the axis of i, two relations: what is left of a revolute joint where a planar loop is closed."""
    i = i.turned(axis)
    return Joint(name, (offset(i, 0, j), offset(i, 1, j)))


def cylindrical(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """The axes of i and j on one line: four relations."""
    i, j = i.turned(axis), j.turned(axis)
    return Joint(name, (*pin(name, i, j).relations, dot(i, 0, j, 2), dot(i, 1, j, 2)), (cosine(i, 2, j, 2),))


def prismatic(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """j slides along the axis of i without turning: five relations."""
    i, j = i.turned(axis), j.turned(axis)
    held = (*cylindrical(name, i, j).relations, dot(i, 0, j, 1))
    return Joint(name, held, tuple(cosine(i, k, j, k) for k in range(3)))


def universal(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """p_i = p_j, and with the axis as z, x of i stays at right angles to y of j, the pins of the cross: four relations."""
    i, j = i.turned(axis), j.turned(axis)
    return Joint(name, (*spherical(name, i, j).relations, dot(i, 0, j, 1)))


def coincidence(name: str, i: Frame, j: Frame, components: Sequence[str]) -> Joint:
    """Components "x", "y" or "z" of p_i = p_j, in global axes: a relation each."""
    return Joint(name, tuple(relations.coincidence(i, j, "xyz".index(k)) for k in components))


def perpendicular(name: str, i: Frame, j: Frame, axis: str, to: str) -> Joint:
    """An axis of i at right angles to one of j, or (to: offset) to the line from p_i to p_j: one relation."""
    a = "xyz".index(axis)
    return Joint(name, (offset(i, a, j) if to == "offset" else dot(i, a, j, "xyz".index(to)),))


def distance(name: str, i: Frame, j: Frame, length: float) -> Joint:
    """|p_j − p_i| = length [m]: one relation."""
    return Joint(name, (distance_squared(i, j, length**2),))


def generic(name: str, i: Frame, j: Frame, held: Sequence[str]) -> Joint:
    """Some of x, y, z, displacements of j along the axes of i, and about_x, about_y, about_z, turns there: a relation each.

    One turn that is held keeps two axes at right angles (about_x y_j·z_i, about_y x_j·z_i, about_z x_j·y_i), two keep the third
    axis of both parallel, three all axes.
    """
    kept: list[Relation] = [offset(i, k, j) for k in range(3) if "xyz"[k] in held]
    turns = [k for k in range(3) if f"about_{'xyz'[k]}" in held]
    parallel: list[int] = []
    if len(turns) == 1:
        a, b = ((2, 1), (2, 0), (1, 0))[turns[0]]
        kept.append(dot(i, a, j, b))
    elif turns:
        free = next((k for k in range(3) if k not in turns), 2)
        a, b = (k for k in range(3) if k != free)
        kept += [dot(i, a, j, free), dot(i, b, j, free)] + [dot(i, a, j, b)] * (len(turns) == 3)
        parallel = [free] if len(turns) == 2 else [0, 1, 2]
    return Joint(name, tuple(kept), tuple(cosine(i, k, j, k) for k in parallel))


def driven_angle(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """j is turned by p(t) about an axis that another joint keeps common: one relation."""
    i, j = i.turned(axis), j.turned(axis)
    turned = DrivenRelation(dot(i, 1, j, 0), name, "angle", dot(i, 0, j, 0))
    return Joint(name, (turned,), (cosine(i, 2, j, 2),))


def driven_displacement(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """p_j is p(t) along an axis of i: one relation."""
    return Joint(name, (DrivenRelation(offset(i, "xyz".index(axis), j), name, "displacement"),))


def driven_distance(name: str, i: Frame, j: Frame) -> Joint:
    """|p_j − p_i| = p(t): one relation."""
    return Joint(name, (DrivenRelation(distance_squared(i, j), name, "length"),))


JOINTS: Mapping[str, Callable[..., Joint]] = {
    "spherical": spherical,
    "revolute": revolute,
    "prismatic": prismatic,
    "cylindrical": cylindrical,
    "universal": universal,
    "pin": pin,
    "fixed": fixed,
    "coincidence": coincidence,
    "perpendicular": perpendicular,
    "distance": distance,
    "generic": generic,
    "driven_angle": driven_angle,
    "driven_displacement": driven_displacement,
    "driven_distance": driven_distance,
}
"""The joints under the names that a config has for them: (name of the joint, first frame, second frame, the keys of its
section) → joint."""
