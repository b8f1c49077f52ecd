"""What really happens in a validation: a model that is not the filter's, its motion, and what its gauges read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
from scipy import sparse

from strainsight.config.placement import PlacementConfig
from strainsight.errors import blame
from strainsight.experiment.recorded import damping_of
from strainsight.experiment.resources import Resources
from strainsight.experiment.structure.candidates import thickness_at
from strainsight.experiment.structure.drawn import (
    in_words,
    installation_of,
    load_error_of,
    loads_vary,
    misaligned_loads,
    model_of,
    varies,
)
from strainsight.experiment.structure.problem import Problem
from strainsight.experiment.structure.reduction import full_model, solver_of
from strainsight.experiment.structure.references import load_shapes, parameters_of, point_loads
from strainsight.experiment.structure.start import Loading, motion_of
from strainsight.fem.affine import Parameter, at_their_references
from strainsight.fem.loads import PointLoad, misaligned_shape, misalignment_shapes
from strainsight.fem.model import FiniteElementModel, FullModel, nodal
from strainsight.loads.histories import instant_values
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import THICKNESS, Thickness
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.training import Training
from strainsight.rom.model import Damping, ReducedModel, accelerations
from strainsight.rom.reduction import Snapshots, modal_model
from strainsight.sensors.candidates import ACCELERATION, Candidates
from strainsight.sensors.installation import Installation, installed_rows
from strainsight.sensors.rows import channel_matrix, channel_rows
from strainsight.sensors.walk import skin_of


class Motion(Protocol):
    """A simulated motion that channels can be read from."""

    def reading(self, channels: np.ndarray) -> np.ndarray:
        """Channels (k,) without noise (T + 1, k) [strain, m/s² or m]."""
        ...


@dataclass(frozen=True)
class ModalMotion:
    """q, acceleration (T + 1, r): coordinates and their second rates; rows (m, r) of all channels; moving (m,): which read
    accelerations; offset (m,) of the readings, and drift (m,) of them by the end [unit of the channel]."""

    q: np.ndarray
    acceleration: np.ndarray
    rows: np.ndarray
    moving: np.ndarray
    offset: np.ndarray
    drift: np.ndarray

    def reading(self, channels: np.ndarray) -> np.ndarray:
        own = self.rows[channels].T
        zero = self.offset[channels] + np.outer(np.linspace(0, 1, len(self.q)), self.drift[channels])
        return np.where(self.moving[channels], self.acceleration @ own, self.q @ own) + zero


@dataclass(frozen=True)
class ReadMotion:
    """readings (T + 1, m) of all channels."""

    readings: np.ndarray

    def reading(self, channels: np.ndarray) -> np.ndarray:
        return self.readings[:, channels]


@dataclass(frozen=True)
class Truth:
    """theta: true parameter values [SI]; description for people; held (gauges,): which a sharp edge has kept from being
    misplaced as far as asked; motion: loads, and how the motion begins → what happens under them; again: number of a
    realisation, and gauges → the truth of these gauges, in their order, with everything drawn anew; None where nothing is
    drawn; field: displacements of all nodes per coordinate of a `ModalMotion` (3 nodes, r), None of another."""

    theta: Mapping[str, float]
    description: str
    held: np.ndarray
    motion: Callable[[Loading], Motion]
    again: Callable[[int, np.ndarray], Truth] | None = None
    field: Callable[[], np.ndarray] | None = None


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
    rich   that, with damping, loads as they act, and gauges as installed, drawn from the tolerances by the seed
    full   all degrees of freedom of the finite-element model in time, gauges in place

    spectrum: modes that hold at any value of the parameters, in place of those found here.
    """
    stated = config.validation.truth
    theta = {**problem.model.reference, **stated.parameters}
    values = ", ".join(f"{name} = {value:.6g}" for name, value in stated.parameters.items()) or "the same parameters"
    pool = training.candidates
    if stated.model == "rom":
        rows = training.rows_at(theta)
        words = f"the filter's own reduced model with {values} (an inverse crime)"
        return _modal(theta, words, np.zeros(pool.gauges, dtype=bool), problem.model, rows, pool)
    parameters = _at(theta, parameters_of(config.parameters, mesh, using.files, config.mesh))
    thickness = thickness_at(mesh, [own for own in parameters if own.property == THICKNESS], theta)
    built = full_model(config.mesh, mesh, parameters, using.files, config.loads, solver_of(config, using))
    modes = built.at_most(stated.modes)
    factor = theta.get(problem.model.damping.parameter, 1.0)
    damping = damping_of(config.damping).scaled(factor)
    with blame("validate.truth"):
        S = load_shapes(built.model, {name: config.loads[name] for name in problem.model.inputs})
    if stated.model == "full":
        words = f"the whole finite-element model in time, {values}"
        return _full(damping, mesh, training, built, S, theta, words, modes, using, thickness)
    loads = point_loads({name: config.loads[name] for name in problem.model.inputs})
    misaligned, static, aside = stated.model == "rich" and misaligned_loads(config), reduced.static, None
    if misaligned:
        aside = misalignment_shapes(built.model, list(loads.values())).reshape(len(static), -1)
        static = np.hstack([static, reduced.misaligned.static.reshape(len(static), -1)])
    shapes = None if spectrum is None else Snapshots(spectrum.frequency, built.in_coordinates(spectrum.shape), static)
    with blame("validate.truth.modes"):
        model, basis = modal_model(built.model, S, problem.model.inputs, theta, modes, damping, shapes, aside)
    whole = "full model" if built.modes is None else f"results ({stated.modes} asked for, {built.modes} there)"
    words = f"{modes} modes of the {whole} with static terms, {values}"
    installed = _installed(mesh, built, basis, training, thickness)
    if stated.model == "modes":
        rows, held = installed(np.arange(pool.gauges), None)
        return replace(_modal(theta, words, held, model, rows, pool), field=partial(nodal, built.model, basis))
    words += in_words(config, given=training.given is not None)

    def drawn(realisation: int, gauges: np.ndarray) -> Truth:
        installation = installation_of(config, pool, realisation).take(pool, gauges)
        with blame("tolerances"):
            rows, held = installed(gauges, installation)
        own, part = model_of(config, model, realisation), pool.take(pool.channels(gauges))
        if loads_vary(config):
            own = own.acted_on(basis.T @ _loaded(config, built.model, loads, problem.known, realisation))
        truth = _modal(theta, words, held, own, rows, part, installation)
        return replace(truth, field=partial(nodal, built.model, basis))

    return replace(drawn(0, np.arange(pool.gauges)), again=drawn if varies(config) else None)


def _loaded(
    config: PlacementConfig,
    model: FiniteElementModel,
    loads: Mapping[str, PointLoad],
    known: Sequence[str],
    realisation: int,
) -> np.ndarray:
    """Input shape (n_free, n_u) of the loads as they act in one realisation."""
    columns = []
    for name, load in loads.items():
        off = load_error_of(config, name, name in known, realisation)
        columns.append(off.factor * misaligned_shape(model, load, off.turn, off.shift))
    return np.column_stack(columns)


Installed = Callable[[np.ndarray, Installation | None], tuple[np.ndarray, np.ndarray]]


def _installed(
    mesh: Mesh, built: FullModel, basis: np.ndarray, training: Training, thickness: Thickness | None
) -> Installed:
    """Gauges (k,) and how they are installed, None: as meant → rows of their channels (m, r), and which (k,) an edge holds.

    Of given strain rows only the gain can be off.
    """
    pool = training.candidates
    if training.given is not None:
        given = training.given @ (built.motion @ basis)

        def scaled(gauges: np.ndarray, installation: Installation | None) -> tuple[np.ndarray, np.ndarray]:
            gain = 0.0 if installation is None else installation.gain[:, None]
            return (1 + gain) * given[pool.channels(gauges)], np.zeros(len(gauges), dtype=bool)

        return scaled
    field, skin = nodal(built.model, basis), skin_of(mesh.position, exterior_facets(mesh))

    def bonded(gauges: np.ndarray, installation: Installation | None) -> tuple[np.ndarray, np.ndarray]:
        part = pool.take(pool.channels(gauges))
        if installation is None:
            rows = channel_rows(mesh.position, part, field, facets=skin, thickness=thickness)
            return rows, np.zeros(len(gauges), dtype=bool)
        return installed_rows(mesh.position, part, field, installation, facets=skin, thickness=thickness)

    return bonded


def _modal(
    theta: Mapping[str, float],
    words: str,
    held: np.ndarray,
    model: ReducedModel,
    rows: np.ndarray,
    pool: Candidates,
    installation: Installation | None = None,
) -> Truth:
    # A model of the truth has the true values for its reference; the filter's own model is taken there.
    at = {name: theta[name] for name in model.reference}
    exact = np.zeros(len(pool))
    zero = (exact, exact) if installation is None else (installation.offset, installation.drift)

    def motion(loading: Loading) -> Motion:
        x = motion_of(model, at, loading)
        a = accelerations(model, at, x, instant_values(loading.held))
        return ModalMotion(x[:, : model.size], a, rows, pool.quantity == ACCELERATION, *zero)

    return Truth(theta, words, held, motion)


def _full(
    stated: Damping,
    mesh: Mesh,
    training: Training,
    built: FullModel,
    S: np.ndarray,
    theta: Mapping[str, float],
    words: str,
    modes: int,
    using: Resources,
    thickness: Thickness | None,
) -> Truth:
    """stated: the damping; modes: how many have its ratio."""
    # with solvers that no other truth needs
    from strainsight.fem.factorisation import relief_of
    from strainsight.fem.transient import ViscousDamping, free_rows, modal_damping, steady_state, transient

    K, M = built.model.stiffness.at(theta), built.model.mass.at(theta)
    if built.model.rigid is not None:
        S = relief_of(M, built.model.rigid).balanced(S)  # the rigid motion drifts away, and no gauge reads it
    if stated.kind == "modal":
        viscous = modal_damping(K, M, stated.ratio, modes, rigid=built.model.rigid)
    else:
        viscous = ViscousDamping(stated.alpha, stated.beta)
    pool = training.candidates
    if training.given is not None:
        assert built.motion is not None
        rows = sparse.csr_array(training.given @ built.motion)
    else:
        rows = free_rows(built.model, channel_matrix(mesh.position, pool, exterior_facets(mesh), thickness))
    moving = pool.quantity == ACCELERATION

    def motion(loading: Loading) -> Motion:
        tones, lead = loading.tones, len(loading.lead)
        with blame("validate.truth"):
            start = None if tones is None else steady_state(K, M, S, viscous, tones.frequency, tones.amplitude)
            found = transient(
                built.model,
                S,
                theta,
                viscous,
                np.concatenate([loading.lead, loading.held]),
                loading.h,
                rows[np.flatnonzero(~moving)],
                rows[np.flatnonzero(moving)] if moving.any() else None,
                start=start,
                progress=lambda share: using.progress("truth", 0.2 * share),
            )
        readings = np.empty((len(loading.held) + 1, len(moving)))
        readings[:, ~moving], readings[:, moving] = found.reading[lead:], found.acceleration[lead:]
        return ReadMotion(readings)

    return Truth(theta, words, np.zeros(pool.gauges, dtype=bool), motion)


def _at(theta: Mapping[str, float], parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
    return at_their_references([replace(p, reference=theta[p.name]) for p in parameters])
