"""Joints: relations held at zero."""

from __future__ import annotations

from dataclasses import dataclass

from strainsight.multibody.frames import Frame
from strainsight.multibody.relations import Relation, coincidence, dot, offset


@dataclass(frozen=True)
class Joint:
    """φ(q) = 0 (1.2) for every relation; any tuple of relations makes a joint."""

    name: str
    relations: tuple[Relation, ...]


def spherical(name: str, i: Frame, j: Frame) -> Joint:
    """p_i = p_j: three relations."""
    return Joint(name, tuple(coincidence(i, j, k) for k in range(3)))


def revolute(name: str, i: Frame, j: Frame) -> Joint:
    """p_i = p_j, and z of j stays along z of i: five relations."""
    return Joint(name, (*spherical(name, i, j).relations, dot(i, 0, j, 2), dot(i, 1, j, 2)))


def pin(name: str, i: Frame, j: Frame) -> Joint:
    """j on the z axis of i, two relations: what is left of a revolute joint where a planar loop is closed."""
    return Joint(name, (offset(i, 0, j), offset(i, 1, j)))


def cylindrical(name: str, i: Frame, j: Frame) -> Joint:
    """The z axes of i and j on one line: four relations."""
    return Joint(name, (*pin(name, i, j).relations, dot(i, 0, j, 2), dot(i, 1, j, 2)))


def prismatic(name: str, i: Frame, j: Frame) -> Joint:
    """j slides along z of i without turning: five relations."""
    return Joint(name, (*cylindrical(name, i, j).relations, dot(i, 0, j, 1)))


def universal(name: str, i: Frame, j: Frame) -> Joint:
    """p_i = p_j, and x of i stays at right angles to y of j: four relations."""
    return Joint(name, (*spherical(name, i, j).relations, dot(i, 0, j, 1)))


def fixed(name: str, i: Frame, j: Frame) -> Joint:
    """p_i = p_j and parallel axes: six relations."""
    return Joint(name, (*revolute(name, i, j).relations, dot(i, 0, j, 1)))
