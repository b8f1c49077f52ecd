"""Errors of masses and natural frequencies of the model, with σ from the tolerances."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.conditional import acceleration_rows, theta_at
from strainsight.estimation.model import FilterModel
from strainsight.experiment.structure.structure import Structure
from strainsight.mesh.additions import nodes_at
from strainsight.rom.model import ReducedModel, modal_basis

BY_MODE = 0.5
"""σ of the frequency error of a single mode, relative to that common to all modes."""
SHARE, MOST = 0.999, 6
"""Share of the inertial readings in training covered by modes with separate frequency errors, and most such modes."""


def load_mass_std(structure: Structure) -> np.ndarray:
    """σ (n_u,) of the mass that the model lacks at each force [kg]; 0 for other loads."""
    loads, std = structure.config.loads, structure.tolerances.load_mass
    forces = [loads[name].unit == "N" for name in structure.reduced.model.inputs]
    return np.where(forces, std * structure.mass if std > 0 else 0.0, 0.0)


def inertia_rows(mass: np.ndarray, model: FilterModel) -> np.ndarray:
    """`ConsideredParameters.inertia` of masses with σ (n_u,) [kg] at the loads, at the guess."""
    unknown, rom = model.columns[0], model.model
    if not mass[unknown].any():
        return np.zeros((0, 0))
    at_guess = theta_at(model, np.zeros((1, len(model.unknowns.parameters))))
    accelerations = np.concatenate(acceleration_rows(model, at_guess, rom.input_shape[:, unknown].T), axis=-1)[0]
    return np.asarray((mass[unknown] / model.amplitude)[:, None] * accelerations)


def mass_errors(
    structure: Structure, model: ReducedModel, turned: np.ndarray, field: np.ndarray, known_only: bool = False
) -> tuple[np.ndarray, ...]:
    """Mass errors σ s sᵀ in the coordinates of the model: a factor √σ s (n, a) of each uncertain mass, which moves along a axes.

    Masses at forces have the input shapes of three perpendicular unit forces as s; point masses with `std` the displacements of
    their nodes. turned (n, n_u, 2): change of the input shape by rotations of the forces [1/rad]; field (3 nodes, n):
    displacement of all nodes per coordinate; known_only: without masses at unknown loads."""
    config = structure.config
    along = np.concatenate([model.input_shape[:, :, None], turned], axis=2)
    wanted = [config.loads[name].known or not known_only for name in model.inputs]
    factors = [np.sqrt(std) * along[:, i] for i, std in enumerate(load_mass_std(structure)) if wanted[i]]
    for entry in config.mesh.point_masses.values():
        nodes = nodes_at(structure.mesh, entry.node, entry.set)
        share = np.sqrt(entry.std / len(nodes))
        factors.append(share * field.reshape(-1, 3, field.shape[1])[nodes].reshape(3 * len(nodes), -1).T)
    return tuple(factor for factor in factors if factor.any())


def frequency_errors(structure: Structure, rows: np.ndarray) -> tuple[np.ndarray, int]:
    """σ (k, n) of ln ω of n modes: one common error, one for every mode that channels with these rows (m, n) measure, and one
    for every uncertain mass, except those at unknown loads (`inertia_std`); and the number of the latter.

    Inertia of mode j adds −q̈ⱼ/λⱼ to its static response. A mass error dm = σ s sᵀ changes, to first order (Rayleigh),

        d ln ωⱼ = −½ φⱼᵀ dm φⱼ
    """
    model, std = structure.reduced.model, structure.tolerances.frequency
    n = model.size
    if structure.config.train.model == "static":
        return np.zeros((0, n)), 0
    lam, phi = modal_basis(model, model.reference)
    turned = structure.reduced.misaligned.shape[..., :2]
    by_mass = [
        -0.5 * np.sum((phi.T @ s) ** 2, axis=1)
        for s in mass_errors(structure, model, turned, structure.reduced.basis, True)
    ]
    if std == 0:
        return np.array(by_mass).reshape(-1, n), len(by_mass)
    square = (rows * np.sqrt(np.mean(structure.training.acceleration**2, axis=0)) / lam) ** 2
    whole = square.sum(axis=1, keepdims=True)
    share = np.divide(square, whole, out=np.zeros_like(square), where=whole > 0).mean(axis=0)
    order = np.argsort(-share, kind="stable")[:MOST]
    before = np.cumsum(share[order]) - share[order]
    each = np.sort(order[before < SHARE * share.sum()])
    of_modes = std * np.concatenate([np.ones((1, n)), BY_MODE * np.eye(n)[each]])
    return np.concatenate([of_modes, np.array(by_mass).reshape(-1, n)]), len(by_mass)
