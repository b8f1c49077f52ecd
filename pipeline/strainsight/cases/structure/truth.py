"""What really happens in a validation: a model that is not the filter's, its motion, and what its gauges read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy import sparse

from strainsight.cases.resources import Resources
from strainsight.cases.structure.channels import accelerations
from strainsight.cases.structure.full_model import FullModel, full_model
from strainsight.cases.structure.problem import Problem
from strainsight.cases.structure.settings import load_shapes, parameters_of
from strainsight.config.placement import PlacementConfig
from strainsight.config.validation import Truth as StatedTruth
from strainsight.errors import blame
from strainsight.fem.affine import Parameter
from strainsight.fem.model import nodal
from strainsight.gauges.candidates import ACCELERATION, Candidates
from strainsight.gauges.misplaced import misplaced
from strainsight.gauges.rows import channel_matrix, channel_rows
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.training import Training
from strainsight.rom.modal_step import simulate
from strainsight.rom.model import ReducedModel
from strainsight.rom.reduction import modal_model
from strainsight.rom.snapshots import Snapshots
from strainsight.signals.histories import instant_values


class Motion(Protocol):
    """A simulated motion that channels can be read from."""

    def reading(self, channels: np.ndarray) -> np.ndarray:
        """Channels (k,) without noise (T + 1, k) [strain, m/s² or m]."""
        ...


@dataclass(frozen=True)
class ModalMotion:
    """q, acceleration (T + 1, r): coordinates and their second rates; rows (m, r) of all channels; moving (m,): which read
    accelerations."""

    q: np.ndarray
    acceleration: np.ndarray
    rows: np.ndarray
    moving: np.ndarray

    def reading(self, channels: np.ndarray) -> np.ndarray:
        own = self.rows[channels].T
        return np.where(self.moving[channels], self.acceleration @ own, self.q @ own)


@dataclass(frozen=True)
class ReadMotion:
    """readings (T + 1, m) of all channels."""

    readings: np.ndarray

    def reading(self, channels: np.ndarray) -> np.ndarray:
        return self.readings[:, channels]


@dataclass(frozen=True)
class Truth:
    """theta: true parameter values [SI]; description for people; held (gauges,): which a sharp edge has kept from being
    misplaced as far as asked; motion: held loads (T, HOLD, n_u) and step h [s] → what happens under them, from rest."""

    theta: Mapping[str, float]
    description: str
    held: np.ndarray
    motion: Callable[[np.ndarray, float], Motion]


def truth_of(
    config: PlacementConfig,
    mesh: Mesh,
    spectrum: Modes | None,
    reduced: Reduced,
    training: Training,
    problem: Problem,
    using: Resources,
) -> Truth:
    """The truth that the config asks for:

    rom    the filter's own model at the true parameters: an inverse crime, and reported as one (the thesis's case)
    modes  `modes` modes with their static terms at the true parameters
    rich   that, with other damping and misplaced gauges
    full   all degrees of freedom of the finite-element model in time, gauges in place

    spectrum: modes that hold at any value of the parameters, in place of those found here.
    """
    stated = config.validation.truth
    theta = {**problem.model.reference, **stated.parameters}
    values = ", ".join(f"{name} = {value:.6g}" for name, value in stated.parameters.items()) or "the same parameters"
    pool = training.candidates
    if stated.model == "rom":
        rows = training.rows
        words = f"the filter's own reduced model with {values} (an inverse crime)"
        return _modal(theta, words, np.zeros(pool.gauges, dtype=bool), problem.model, rows, pool)
    parameters = _at(theta, parameters_of(config.parameters, mesh, using.files, config.mesh.matrices))
    built = full_model(config.mesh, mesh, parameters, using.files)
    with blame("validate.truth"):
        S = load_shapes(built.model, {name: config.loads[name] for name in problem.model.inputs})
    if stated.model == "full":
        words = f"the whole finite-element model in time, {values}"
        return _full(problem, mesh, training, built, S, theta, words, stated.modes, using)
    rich = stated.model == "rich"
    damping = problem.model.damping.scaled(stated.damping_factor if rich else 1.0)
    shapes = None if spectrum is None else Snapshots(spectrum.frequency, spectrum.shape, reduced.static)
    with blame("validate.truth.modes"):
        model, basis = modal_model(built.model, S, problem.model.inputs, theta, stated.modes, damping, shapes)
    words = f"{stated.modes} modes of the full model with static terms, {values}"
    if rich:
        words += f", damping × {stated.damping_factor:g}"
    given = training.given
    held = np.zeros(pool.gauges, dtype=bool)
    if given is not None:
        words += ", gauges exactly in place, because given strain rows cannot be moved or turned" * rich
        return _modal(theta, words, held, model, given @ (built.motion @ basis), pool)
    facets = exterior_facets(mesh)
    if rich:
        words += f", gauges off by {1e3 * stated.gauge_offset:g} mm and {stated.gauge_rotation:g}°"
        with blame("validate.truth.gauge_offset"):
            pool, held = _bonded_badly(mesh, facets, pool, stated, config.seed)
    rows = channel_rows(mesh.position, pool, nodal(built.model, basis), facets=facets)
    return _modal(theta, words, held, model, rows, pool)


def _modal(
    theta: Mapping[str, float], words: str, held: np.ndarray, model: ReducedModel, rows: np.ndarray, pool: Candidates
) -> Truth:
    # A model of the truth has the true values for its reference; the filter's own model is taken there.
    at = {name: theta[name] for name in model.reference}

    def motion(u: np.ndarray, h: float) -> Motion:
        x = simulate(model, at, u, h)
        a = accelerations(model, at, x, instant_values(u))
        return ModalMotion(x[:, : model.size], a, rows, pool.quantity == ACCELERATION)

    return Truth(theta, words, held, motion)


def _full(
    problem: Problem,
    mesh: Mesh,
    training: Training,
    built: FullModel,
    S: np.ndarray,
    theta: Mapping[str, float],
    words: str,
    modes: int,
    using: Resources,
) -> Truth:
    """modes: how many have the damping ratio of the filter's model."""
    # with solvers that no other truth needs
    from strainsight.fem.transient import free_rows, transient
    from strainsight.fem.viscous import ViscousDamping, modal_damping

    K, M, stated = built.model.stiffness.at(theta), built.model.mass.at(theta), problem.model.damping
    if stated.kind == "modal":
        viscous = modal_damping(K, M, stated.ratio, modes)
    else:
        viscous = ViscousDamping(stated.alpha, stated.beta)
    pool = training.candidates
    if training.given is not None:
        assert built.motion is not None
        rows = sparse.csr_array(training.given @ built.motion)
    else:
        rows = free_rows(built.model, channel_matrix(mesh.position, pool, exterior_facets(mesh)))
    moving = pool.quantity == ACCELERATION

    def motion(u: np.ndarray, h: float) -> Motion:
        with blame("validate.truth"):
            found = transient(
                built.model,
                S,
                theta,
                viscous,
                u,
                h,
                rows[np.flatnonzero(~moving)],
                rows[np.flatnonzero(moving)] if moving.any() else None,
                progress=lambda share: using.progress("truth", 0.2 * share),
            )
        readings = np.empty((len(u) + 1, len(moving)))
        readings[:, ~moving], readings[:, moving] = found.reading, found.acceleration
        return ReadMotion(readings)

    return Truth(theta, words, np.zeros(pool.gauges, dtype=bool), motion)


def _bonded_badly(
    mesh: Mesh, facets: Facets, pool: Candidates, stated: StatedTruth, seed: int
) -> tuple[Candidates, np.ndarray]:
    """Every gauge off in a random direction and turned by ± its angle; those already bonded are where they are."""
    rng = np.random.default_rng(seed)
    heading = rng.uniform(0, 2 * np.pi, pool.gauges)
    free = ~pool.bonded[pool.first]
    offset = stated.gauge_offset * np.column_stack([np.cos(heading), np.sin(heading)]) * free[:, None]
    rotation = stated.gauge_rotation * rng.choice([-1.0, 1.0], pool.gauges) * free
    return misplaced(mesh.position, pool, facets, offset, rotation)


def _at(theta: Mapping[str, float], parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
    return tuple(replace(p, reference=theta[p.name]) for p in parameters)
