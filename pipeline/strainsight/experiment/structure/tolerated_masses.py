"""Errors of masses and natural frequencies of the model, with σ from the tolerances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.estimation.conditional import (
    ConsideredParameters,
    acceleration_rows,
    linear_models,
    none_considered,
    theta_at,
)
from strainsight.estimation.error_steps import states_at
from strainsight.estimation.grid_filter import feels_lacking_mass
from strainsight.estimation.model import FilterModel
from strainsight.estimation.record import GridRecord
from strainsight.experiment.structure.problem import Problem
from strainsight.experiment.structure.start import motion_of
from strainsight.experiment.structure.structure import Structure
from strainsight.mesh.additions import nodes_at
from strainsight.rom.model import modal_basis
from strainsight.sensors.candidates import ACCELERATION

BY_MODE = 0.5
"""σ of the frequency error of a single mode, relative to that common to all modes."""
TYPICAL_MASS, LEAST_SHIFT = 0.01, 1e-3
"""Mass of an accelerometer with cable [kg], and the smallest relative change of a frequency that is reported."""
STEP = 0.1
"""Mass, in σ, for the slope of the readings."""
SHARE, MOST = 0.999, 6
"""Share of the inertial readings in training covered by modes with separate frequency errors, and most such modes."""


def load_mass_std(structure: Structure) -> np.ndarray:
    """σ (n_u,) of the mass that the model lacks at each unknown force [kg]; 0 for other loads."""
    config, std = structure.config, structure.tolerances.load_mass
    names = structure.reduced.model.inputs
    unknown = [config.loads[name].unit == "N" and name in config.place.estimate for name in names]
    return np.where(unknown, std * structure.mass if std > 0 and any(unknown) else 0.0, 0.0)


def inertia_rows(mass: np.ndarray, model: FilterModel) -> np.ndarray:
    """`ConsideredParameters.inertia` of masses with σ (n_u,) [kg] at the loads, at the guess."""
    unknown, rom = model.columns[0], model.model
    if not mass[unknown].any():
        return np.zeros((0, 0))
    at_guess = theta_at(model, np.zeros((1, len(model.unknowns.parameters))))
    accelerations = np.concatenate(acceleration_rows(model, at_guess, rom.input_shape[:, unknown].T), axis=-1)[0]
    return np.asarray((mass[unknown] / model.amplitude)[:, None] * accelerations)


def sensor_masses_in_words(structure: Structure, channels: np.ndarray) -> str:
    """Warning if accelerometers (channels (m,) of train.h5) without mass in the model would change the first frequency by more
    than its tolerance; else empty. Each has TYPICAL_MASS along its axis."""
    training, model = structure.training, structure.reduced.model
    moving = channels[training.candidates.quantity[channels] == ACCELERATION]
    _, phi = modal_basis(model, model.reference)
    fall = 0.5 * TYPICAL_MASS * float(np.sum((training.rows[moving] @ phi[:, 0]) ** 2))
    if structure.config.mesh.point_masses or fall <= max(structure.tolerances.frequency, LEAST_SHIFT):
        return ""
    return (
        f"the model has no masses of the {len(moving)} accelerometers: with {1e3 * TYPICAL_MASS:g} g each, mode 1 falls by "
        f"{100 * fall:.2g} %, but tolerances.frequency is {100 * structure.tolerances.frequency:g} %. Add their masses to "
        "mesh.point_masses"
    )


def point_mass_errors(structure: Structure, field: np.ndarray) -> tuple[np.ndarray, ...]:
    """Errors m mᵀ of the mass matrix by each uncertain point mass: m (n, a) in the coordinates of field (3 nodes, n), the
    displacement of all nodes."""
    factors = []
    for entry in structure.config.mesh.point_masses.values():
        nodes = nodes_at(structure.mesh, entry.node, entry.set)
        moved = field.reshape(-1, 3, field.shape[1])[nodes].reshape(3 * len(nodes), -1)
        factors += [np.sqrt(entry.std / len(nodes)) * moved.T] * (entry.std > 0)
    return tuple(factors)


def load_mass_errors(structure: Structure, input_shape: np.ndarray, turned: np.ndarray) -> tuple[np.ndarray, ...]:
    """Errors m mᵀ of the mass matrix by the masses at unknown forces, one at each place: m (n, 3), the input shape (n, n_u) of
    three perpendicular unit forces; turned (n, n_u, 2): its change by rotations of the force [1/rad]."""
    shapes = np.concatenate([input_shape[:, :, None], turned], axis=2)
    loads, std = structure.config.loads, load_mass_std(structure)
    at: dict[tuple[object, ...], np.ndarray] = {}
    for i, name in enumerate(structure.reduced.model.inputs):
        if std[i] > 0:
            at.setdefault((loads[name].node, loads[name].set, loads[name].deck_load), np.sqrt(std[i]) * shapes[:, i])
    return tuple(at.values())


def lacking_mass(structure: Structure) -> np.ndarray:
    """`ConsideredParameters.lacking` of the masses at k places of unknown forces: their change of the mass matrix (r, r), by a
    factor that gives the sum of k changes |sᵢ| c, sᵢ standard normal, its RMS k c √((1 + (k − 1) 2/π)/k)."""
    reduced = structure.reduced
    errors = load_mass_errors(structure, reduced.model.input_shape, reduced.misaligned.shape[..., :2])
    if structure.config.train.model == "static" or not errors:
        return np.zeros((0, 0))
    k = len(errors)
    return np.asarray(np.sqrt((1 + (k - 1) * 2 / np.pi) / k) * sum(m @ m.T for m in errors))


def readings_of_mass(problem: Problem, model: FilterModel, considered: ConsideredParameters) -> np.ndarray | None:
    """Change (T, m) of the readings in the training simulation by one σ of the masses at unknown loads, to first order; None
    without effect (`feels_lacking_mass`)."""
    known, size = problem.u[..., model.columns[1]], model.size
    considered = replace(considered, lacking=STEP * considered.lacking)
    record = GridRecord(model, np.zeros(size), np.zeros((size, size)), known, np.zeros((0, 0)), considered)
    if not feels_lacking_mass(record):
        return None
    loads, readings = np.concatenate([problem.u[:1, 0], problem.u.sum(axis=1)]), []
    for each in (model, record.with_lacking_mass().model):
        x = motion_of(each.model, each.model.reference, problem.loading)
        one = linear_models(each, np.zeros((1, len(problem.unknowns.parameters))), none_considered(each))
        readings.append(states_at(each, x, loads)[1:] @ one.H[0].T + loads[1:, model.columns[1]] @ one.F[0].T)
    return np.asarray((readings[1] - readings[0]) / STEP)


def frequency_errors(structure: Structure, rows: np.ndarray) -> tuple[np.ndarray, int]:
    """σ (k, n) of ln ω of n modes: one common error, one for every mode that channels with these rows (m, n) measure, and one
    for every uncertain point mass; and the number of the latter. Masses at unknown loads: `inertia_std`.

    Inertia of mode j adds −q̈ⱼ/λⱼ to its static response. A mass error m mᵀ changes, to first order (Rayleigh),

        d ln ωⱼ = −½ (φⱼᵀ m)(mᵀφⱼ)
    """
    model, std = structure.reduced.model, structure.tolerances.frequency
    n = model.size
    if structure.config.train.model == "static":
        return np.zeros((0, n)), 0
    lam, phi = modal_basis(model, model.reference)
    errors = point_mass_errors(structure, structure.reduced.basis)
    by_mass = np.array([-0.5 * np.sum((phi.T @ m) ** 2, axis=1) for m in errors]).reshape(-1, n)
    if std == 0:
        return by_mass, len(by_mass)
    square = (rows * np.sqrt(np.mean(structure.training.acceleration**2, axis=0)) / lam) ** 2
    whole = square.sum(axis=1, keepdims=True)
    share = np.divide(square, whole, out=np.zeros_like(square), where=whole > 0).mean(axis=0)
    order = np.argsort(-share, kind="stable")[:MOST]
    before = np.cumsum(share[order]) - share[order]
    each = np.sort(order[before < SHARE * share.sum()])
    of_modes = std * np.concatenate([np.ones((1, n)), BY_MODE * np.eye(n)[each]])
    return np.concatenate([of_modes, by_mass]), len(by_mass)
