"""What really happens in a validation: a model that is not the filter's, with errors of installation, loads, damping and
stiffness that are sampled from the tolerances; its motion, and what its gauges read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from zlib import crc32

import numpy as np
from scipy import sparse

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.errors import blame
from strainsight.experiment.recorded import damping_of
from strainsight.experiment.structure.candidates import thickness_at
from strainsight.experiment.structure.problem import Problem
from strainsight.experiment.structure.reduction import full_model, solver_of
from strainsight.experiment.structure.references import load_shapes, parameters_of, point_loads
from strainsight.experiment.structure.start import Loading, motion_of
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.system import Resources, installation_std
from strainsight.fem.affine import Parameter, at_their_references, of_stiffness
from strainsight.fem.loads import PointLoad, misaligned_shape, misalignment_shapes
from strainsight.fem.model import FiniteElementModel, FullModel, nodal
from strainsight.loads.histories import instant_values
from strainsight.mesh.properties import SECTION_FACTORS, THICKNESS, Thickness
from strainsight.records.reduced import Modes
from strainsight.rom.model import Damping, ReducedModel, accelerations, first_of_equal, modal_basis
from strainsight.rom.reduction import Snapshots, modal_model
from strainsight.sensors.candidates import ACCELERATION, Candidates
from strainsight.sensors.installation import Installation, drawn_installation, installed_rows
from strainsight.sensors.rows import channel_matrix, channel_rows

INSTALLATION, MODEL, LOADS = 1, 2, 3
"""Streams of the random numbers of gauges, of the model and of loads, apart from those of the noise."""
BY_MODE = 0.5
"""σ of the natural frequency of one mode beside the others, over that of all alike."""


@dataclass(frozen=True)
class LoadError:
    """How a load really acts: turn (2,) [rad] about and shift (2,) [m] along two axes across it; factor [-] on the force that is
    known of it."""

    turn: np.ndarray
    shift: np.ndarray
    factor: float


def installation_of(config: PlacementConfig, pool: Candidates, realisation: int) -> Installation:
    """Draw number `realisation` of the config's seed, 0 that of the layout's own measurement.

    A place or direction that `validate.truth` states has that size, in a direction that is drawn once for all realisations.
    """
    stated = config.validation.truth
    rng = np.random.default_rng([config.seed, realisation, INSTALLATION])
    installation = drawn_installation(pool, installation_std(tolerances_of(config.tolerances)), rng)
    fixed = np.random.default_rng(config.seed)
    grids = pool.grids
    heading, way = fixed.uniform(0, 2 * np.pi, grids.gauges), fixed.choice([-1.0, 1.0], grids.gauges)
    free = ~grids.bonded[grids.first]
    if stated.gauge_offset is not None:
        ahead = np.column_stack([np.cos(heading), np.sin(heading)])
        installation = replace(installation, place=stated.gauge_offset * ahead * free[:, None])
    if stated.gauge_rotation is not None:
        turn = np.deg2rad(stated.gauge_rotation) * way * free
        installation = replace(installation, angle=turn, tilt=np.zeros_like(installation.tilt))
    return installation


def load_error_of(config: PlacementConfig, name: str, known: bool, realisation: int) -> LoadError:
    """Of one load, which the others do not change: its name has a stream of its own. Only a known load has a gain."""
    tolerances = tolerances_of(config.tolerances)
    rng = np.random.default_rng([config.seed, realisation, LOADS, crc32(name.encode())])
    turn, shift, gain = rng.standard_normal(2), rng.standard_normal(2), rng.standard_normal()
    return LoadError(
        np.deg2rad(tolerances.load_angle) * turn,
        tolerances.load_position * shift,
        1.0 + (tolerances.load_gain * gain if known else 0.0),
    )


def _some_known(config: PlacementConfig) -> bool:
    return any(name not in config.place.estimate for name in config.loads)


def misaligned_loads(config: PlacementConfig) -> bool:
    """Whether their direction or point is not exact."""
    tolerances = tolerances_of(config.tolerances)
    return tolerances.load_angle > 0 or tolerances.load_position > 0


def model_of(config: PlacementConfig, model: ReducedModel, realisation: int) -> ReducedModel:
    """The model with drawn damping, ζᵢ = ζ exp(sᵢ ln f) with a normal sᵢ for every mode, drawn natural frequencies,
    ωᵢ = ω exp(σ (s + sᵢ BY_MODE)) by the mass of every mode, and one drawn scale of the stiffness, K exp(s σ).

    A `damping_factor` that `validate.truth` states holds for every mode and realisation. The stiffness keeps its scale where a
    modulus is estimated.
    """
    tolerances, stated = tolerances_of(config.tolerances), config.validation.truth.damping_factor
    rng = np.random.default_rng([config.seed, realisation, MODEL])
    scale = np.exp(tolerances.model * rng.standard_normal())
    factors = np.exp(np.log(tolerances.damping) * rng.standard_normal(model.size))
    common, by_mode = rng.standard_normal(), rng.standard_normal(model.size)
    if stated is not None:
        model = replace(model, damping=model.damping.scaled(stated))
    elif tolerances.damping > 1:
        model = replace(model, damping=model.damping.scaled(factors.tolist()))
    if tolerances.frequency > 0:
        # the coordinates are the modes
        same = first_of_equal(modal_basis(model, model.reference)[0])
        f = np.exp(tolerances.frequency * (common + BY_MODE * by_mode[same]))
        model = replace(model, mass=model.mass.of_all(lambda X: X / np.outer(f, f)))
    if tolerances.model > 0 and not modulus_estimated(config):
        model = replace(model, stiffness=model.stiffness.of_all(lambda X: scale * X))
    return model


def _sources(config: PlacementConfig, by_rows: bool) -> list[str]:
    """What is drawn with which σ; by_rows: whether the gauges are given by their strain rows, which cannot be moved or turned."""
    tolerances, stated, moved = tolerances_of(config.tolerances), config.validation.truth, not by_rows
    damped = [f"ln ζ of every mode ln {tolerances.damping:g}"] * (
        tolerances.damping > 1 and stated.damping_factor is None
    )
    sources = (
        ("frequency", 100, "natural frequencies {:g} %", True),
        ("model", 100, "stiffness {:g} %", not modulus_estimated(config)),
        ("position", 1e3, "place {:g} mm each way", moved and stated.gauge_offset is None),
        ("angle", 1, "direction {:g}°", moved and stated.gauge_rotation is None),
        ("gain", 100, "gain {:g} %", True),
        ("transverse", 100, "transverse sensitivity {:g} %", moved),
        ("offset", 1e6, "offset {:g} µm/m", True),
        ("drift", 1e6, "drift {:g} µm/m", True),
        ("temperature", 1, "temperature {:g} K", any(installation_std(tolerances).warmed)),
        ("load_angle", 1, "direction of loads {:g}°", True),
        ("load_position", 1e3, "point of loads {:g} mm", True),
        ("load_gain", 100, "gain of known loads {:g} %", _some_known(config)),
    )
    sizes = ((factor * getattr(tolerances, key), words, applies) for key, factor, words, applies in sources)
    return damped + [words.format(size) for size, words, applies in sizes if size > 0 and applies]


def varies(config: PlacementConfig) -> bool:
    """Whether one realisation differs from another."""
    return bool(_sources(config, by_rows=False))


def in_words(config: PlacementConfig, by_rows: bool) -> str:
    """What is off, for people; by_rows: as of `_sources`. Begins with a comma."""
    stated, fixed = config.validation.truth, []
    if stated.damping_factor is not None:
        fixed.append(f"damping × {stated.damping_factor:g}")
    if by_rows:
        fixed.append("gauges exactly in place, because given strain rows cannot be moved or turned")
    elif stated.gauge_offset is not None or stated.gauge_rotation is not None:
        sizes = ((stated.gauge_offset, 1e3, " mm"), (stated.gauge_rotation, 1.0, "°"))
        parts = (f"{factor * size:g}{unit}" for size, factor, unit in sizes if size is not None)
        fixed.append(f"gauges off by {' and '.join(parts)}")
    drawn = _sources(config, by_rows)
    words = fixed + ([f"drawn with σ: {', '.join(drawn)}"] if drawn else [])
    return "".join(f", {text}" for text in words)


def modulus_estimated(config: PlacementConfig) -> bool:
    """Whether some modulus or factor of the stiffness is among the unknowns, so that one scale of the stiffness is; a factor of
    springs, or of the section of beams, is none, and no thickness."""
    named = [config.parameters[name] for name in config.place.estimate if name in config.parameters]
    of_whole = [
        parameter
        for parameter in named
        if of_stiffness(parameter.property) and parameter.property not in (*SECTION_FACTORS, THICKNESS)
    ]
    return any(parameter.springs is None for parameter in of_whole)


SimulatedMotion = Callable[[np.ndarray], np.ndarray]
"""Channels (k,) → what they read of a simulated motion without noise (T + 1, k) [strain, m/s² or m]."""


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

    def __call__(self, channels: np.ndarray) -> np.ndarray:
        rows = self.rows[channels].T
        zero = self.offset[channels] + np.outer(np.linspace(0, 1, len(self.q)), self.drift[channels])
        return np.where(self.moving[channels], self.acceleration @ rows, self.q @ rows) + zero


@dataclass(frozen=True)
class SimulatedTruth:
    """theta: true parameter values [SI]; description for people; held (gauges,): which a sharp edge has kept from being
    misplaced as far as asked; motion: loads, and how the motion begins → what happens under them; again: number of a
    realisation, and gauges → the truth of these gauges, in their order, with everything drawn anew; None where nothing is
    drawn; field: displacements of all nodes per coordinate of a `ModalMotion` (3 nodes, r), None of another."""

    theta: Mapping[str, float]
    description: str
    held: np.ndarray
    motion: Callable[[Loading], SimulatedMotion]
    again: Callable[[int, np.ndarray], SimulatedTruth] | None = None
    field: Callable[[], np.ndarray] | None = None


def truth_of(structure: Structure, spectrum: Modes | None, problem: Problem, using: Resources) -> SimulatedTruth:
    """The truth that the config asks for:

    rom    the filter's own model at the true parameters: an inverse crime, and reported as one (the thesis's case)
    modes  `modes` modes with their static terms at the true parameters
    rich   that, with damping, loads as they act, and gauges as installed, drawn from the tolerances by the seed
    full   all degrees of freedom of the finite-element model in time, gauges in place

    spectrum: modes that hold at any value of the parameters, in place of those found here.
    """
    config, mesh, training, reduced = structure.config, structure.mesh, structure.training, structure.reduced
    stated = config.validation.truth
    theta = {**problem.model.reference, **stated.parameters}
    values = ", ".join(f"{name} = {value:.6g}" for name, value in stated.parameters.items()) or "the same parameters"
    pool = training.candidates
    if stated.model == "rom":
        rows = training.rows_at(theta)
        words = f"the filter's own reduced model with {values} (an inverse crime)"
        return _modal(theta, words, np.zeros(pool.gauges, dtype=bool), problem.model, rows, pool)
    parameters = _at(theta, parameters_of(config.parameters, mesh, using.files, config.mesh))
    thickness = thickness_at(mesh, [parameter for parameter in parameters if parameter.property == THICKNESS], theta)
    built = full_model(config.mesh, mesh, parameters, using.files, config.loads, solver_of(config, using))
    modes = built.at_most(stated.modes)
    factor = theta.get(problem.model.damping.parameter, 1.0)
    damping = damping_of(config.damping).scaled(factor)
    with blame("validate.truth"):
        S = load_shapes(built.model, {name: config.loads[name] for name in problem.model.inputs})
    if stated.model == "full":
        words = f"the whole finite-element model in time, {values}"
        return _full(structure, damping, built, S, theta, words, modes, using, thickness)
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
    installed = _installed(structure, built, basis, thickness)
    if stated.model == "modes":
        rows, held = installed(np.arange(pool.gauges), None)
        return replace(_modal(theta, words, held, model, rows, pool), field=partial(nodal, built.model, basis))
    words += in_words(config, by_rows=training.given is not None)

    def drawn(realisation: int, gauges: np.ndarray) -> SimulatedTruth:
        installation = installation_of(config, pool, realisation).take(pool, gauges)
        with blame("tolerances"):
            rows, held = installed(gauges, installation)
        sampled, part = model_of(config, model, realisation), pool.take(pool.channels(gauges))
        if misaligned_loads(config) or (_some_known(config) and structure.tolerances.load_gain > 0):
            sampled = sampled.acted_on(basis.T @ _loaded(config, built.model, loads, problem.known, realisation))
        truth = _modal(theta, words, held, sampled, rows, part, installation)
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


def _installed(structure: Structure, built: FullModel, basis: np.ndarray, thickness: Thickness | None) -> Installed:
    """Gauges (k,) and how they are installed, None: as meant → rows of their channels (m, r), and which (k,) an edge holds.

    Of given strain rows only the gain can be off.
    """
    training, pool, position = structure.training, structure.pool, structure.mesh.position
    if training.given is not None:
        stated = training.given @ (built.motion @ basis)

        def scaled(gauges: np.ndarray, installation: Installation | None) -> tuple[np.ndarray, np.ndarray]:
            gain = 0.0 if installation is None else installation.gain[:, None]
            return (1 + gain) * stated[pool.channels(gauges)], np.zeros(len(gauges), dtype=bool)

        return scaled
    field, skin = nodal(built.model, basis), structure.skin

    def bonded(gauges: np.ndarray, installation: Installation | None) -> tuple[np.ndarray, np.ndarray]:
        part = pool.take(pool.channels(gauges))
        if installation is None:
            rows = channel_rows(position, part, field, facets=skin, thickness=thickness)
            return rows, np.zeros(len(gauges), dtype=bool)
        return installed_rows(position, part, field, installation, facets=skin, thickness=thickness)

    return bonded


def _modal(
    theta: Mapping[str, float],
    words: str,
    held: np.ndarray,
    model: ReducedModel,
    rows: np.ndarray,
    pool: Candidates,
    installation: Installation | None = None,
) -> SimulatedTruth:
    # A model of the truth has the true values for its reference; the filter's own model is taken there.
    at = {name: theta[name] for name in model.reference}
    exact = np.zeros(len(pool))
    zero = (exact, exact) if installation is None else (installation.offset, installation.drift)

    def motion(loading: Loading) -> SimulatedMotion:
        x = motion_of(model, at, loading)
        a = accelerations(model, at, x, instant_values(loading.held))
        return ModalMotion(x[:, : model.size], a, rows, pool.quantity == ACCELERATION, *zero)

    return SimulatedTruth(theta, words, held, motion)


def _full(
    structure: Structure,
    stated: Damping,
    built: FullModel,
    S: np.ndarray,
    theta: Mapping[str, float],
    words: str,
    modes: int,
    using: Resources,
    thickness: Thickness | None,
) -> SimulatedTruth:
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
    training, pool = structure.training, structure.pool
    if training.given is not None:
        assert built.motion is not None
        rows = sparse.csr_array(training.given @ built.motion)
    else:
        rows = free_rows(built.model, channel_matrix(structure.mesh.position, pool, structure.skin.facets, thickness))
    moving = pool.quantity == ACCELERATION

    def motion(loading: Loading) -> SimulatedMotion:
        tones, lead = loading.tones, len(loading.lead)
        with blame("validate.truth"):
            start = None if tones is None else steady_state(K, M, S, viscous, tones.frequency, tones.amplitude)
            run = transient(
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
        readings[:, ~moving], readings[:, moving] = run.reading[lead:], run.acceleration[lead:]
        return lambda channels: readings[:, channels]

    return SimulatedTruth(theta, words, np.zeros(pool.gauges, dtype=bool), motion)


def _at(theta: Mapping[str, float], parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
    return at_their_references([replace(p, reference=theta[p.name]) for p in parameters])
