"""Loads whose direction and point of action are not those that were meant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from strainsight.fem.couple import couple
from strainsight.fem.loads import PointLoad, moment_forces, nodal_forces, on_rows
from strainsight.fem.model import FiniteElementModel
from strainsight.mesh.forces import NodalForces
from strainsight.ordering import first_of_largest

MISALIGNMENTS = 4
"""Of one load: turns about, and shifts along, two axes across its line of action."""


def axes_across(direction: np.ndarray) -> np.ndarray:
    """Unit vectors a₁, a₂ (2, 3) with a₁ × a₂ = d, the direction (3,) of unit length."""
    first = np.cross(np.eye(3)[first_of_largest(-np.abs(direction))], direction)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(direction, first)])


def misaligned_shape(model: FiniteElementModel, load: PointLoad, turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Input shape (n_free,) [-] of a load of unit resultant that is off by finite turn and shift:

        S = Tᵀ(e(R f) + c(δ × Σ R f)),     R = exp([θ₁a₁ + θ₂a₂]×),   δ = δ₁a₁ + δ₂a₂

    f the forces on its nodes, e puts forces and c a `couple` on them, in proportion to f. A moment turns, and is the same
    wherever it acts; what its nodes cannot exert of the turned one is left out. A pressure, a rotation and a load of the deck
    without resultant have no direction and no point, and what acts on mass has no point that could be another.
    turn θ (2,) [rad] about and shift δ (2,) [m] along the `axes_across`.
    """
    if load.moment is not None:
        axis = np.asarray(load.moment, dtype=float) / np.linalg.norm(load.moment)
        turned = Rotation.from_rotvec(np.asarray(turn) @ axes_across(axis)).apply(axis)
        return np.asarray(model.constraint.transform.T @ moment_forces(model, load, turned, whole=False))
    own = nodal_forces(model.mesh, load)
    if _has_none(load, own):
        return np.asarray(model.constraint.transform.T @ on_rows(model, own))
    axes = _axes_of(own.force)
    off = Rotation.from_rotvec(np.asarray(turn) @ axes)
    rotated = replace(own, force=off.apply(own.force), moment=None if own.moment is None else off.apply(own.moment))
    e = on_rows(model, rotated)
    if not own.regions:
        e += _couple(model, own, np.cross(np.asarray(shift) @ axes, rotated.force.sum(axis=0)))
    return np.asarray(model.constraint.transform.T @ e)


def misalignment_shapes(model: FiniteElementModel, loads: Sequence[PointLoad]) -> np.ndarray:
    """∂S/∂(θ₁, θ₂, δ₁, δ₂) of `misaligned_shape` at zero (n_free, n_u, MISALIGNMENTS) [1/rad, 1/m]:

    Tᵀ e(a × f) of a turn about a, Tᵀ c(a × Σ f) of a shift along a; of a moment Tᵀ c(a × M), and nothing
    of a shift; nothing of a pressure, a rotation and a load of the deck without resultant; no shift of what acts on mass.
    """
    columns = []
    for load in loads:
        if load.moment is not None:
            axis = np.asarray(load.moment, dtype=float) / np.linalg.norm(load.moment)
            turned = [np.cross(across, axis) for across in axes_across(axis)]
            columns += [moment_forces(model, load, moment, whole=False) for moment in turned]
            columns += [np.zeros(model.constraint.transform.shape[0])] * 2
            continue
        own = nodal_forces(model.mesh, load)
        if _has_none(load, own):
            columns += [np.zeros(model.constraint.transform.shape[0])] * MISALIGNMENTS
            continue
        axes, whole = _axes_of(own.force), own.force.sum(axis=0)
        for axis in axes:
            across = None if own.moment is None else np.cross(axis, own.moment)
            columns.append(on_rows(model, replace(own, force=np.cross(axis, own.force), moment=across)))
        columns += [_couple(model, own, np.cross(axis, whole) * (not own.regions)) for axis in axes]
    shapes = np.asarray(model.constraint.transform.T @ np.column_stack(columns))
    return shapes.reshape(model.size, len(loads), MISALIGNMENTS)


def _has_none(load: PointLoad, own: NodalForces) -> bool:
    """Whether a load has neither a direction nor a point."""
    balanced = np.linalg.norm(own.force.sum(axis=0)) <= 1e-9 * np.abs(own.force).sum()
    return load.pressure or load.rotation is not None or bool(balanced)


def _axes_of(force: np.ndarray) -> np.ndarray:
    whole = force.sum(axis=0)
    return axes_across(whole / np.linalg.norm(whole))


def _couple(model: FiniteElementModel, own: NodalForces, moment: np.ndarray) -> np.ndarray:
    return couple(model.mesh, model.constraint, own.nodes, np.linalg.norm(own.force, axis=1), moment)
