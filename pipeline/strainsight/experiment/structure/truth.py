"""Simulated truth of a validation: a model other than the filter's, with errors of installation, loads, damping and stiffness
sampled from the tolerances; its motion and gauge readings."""

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
from strainsight.experiment.structure.tolerated_masses import BY_MODE, load_mass_errors, point_mass_errors
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
from strainsight.sensors.installation import Installation, installed_rows, sample_installation
from strainsight.sensors.strain_operator import channel_matrix, channel_rows

INSTALLATION, MODEL, LOADS = 1, 2, 3
"""Streams of random numbers of gauges, model and loads, independent of the noise."""


@dataclass(frozen=True)
class LoadError:
    """Errors of a load: turn (2,) [rad] about and shift (2,) [m] along two transverse axes; factor [-] on the known force."""

    turn: np.ndarray
    shift: np.ndarray
    factor: float


def installation_of(config: PlacementConfig, pool: Candidates, realisation: int) -> Installation:
    """Sample installation errors, number `realisation` of the config's seed (0 for the layout)."""
    rng = np.random.default_rng([config.seed, realisation, INSTALLATION])
    return sample_installation(pool, installation_std(tolerances_of(config.tolerances)), rng)


def load_error_of(config: PlacementConfig, name: str, known: bool, realisation: int) -> LoadError:
    """Sample the errors of one load, independent of other loads by a stream per name. Only known loads have a gain error."""
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


def _some_unknown_force(config: PlacementConfig) -> bool:
    return any(load.unit == "N" and name in config.place.estimate for name, load in config.loads.items())


def misaligned_loads(config: PlacementConfig) -> bool:
    """Whether loads have direction or point errors."""
    tolerances = tolerances_of(config.tolerances)
    return tolerances.load_angle > 0 or tolerances.load_position > 0


def model_of(
    config: PlacementConfig, model: ReducedModel, realisation: int, masses: Sequence[np.ndarray] = ()
) -> ReducedModel:
    """Sample damping ζᵢ = ζ exp(sᵢ ln f), frequencies ωᵢ = ω exp(σ (s + sᵢ BY_MODE)) by modal mass, masses M + Σ sᵢ m mᵀ,
    and stiffness K exp(s σ).

    s, sᵢ: standard normal, sᵢ per mode; |sᵢ| for masses, which a model lacks. The stiffness is unchanged if a modulus is
    estimated."""
    tolerances = tolerances_of(config.tolerances)
    rng = np.random.default_rng([config.seed, realisation, MODEL])
    scale = np.exp(tolerances.model * rng.standard_normal())
    factors = np.exp(np.log(tolerances.damping) * rng.standard_normal(model.size))
    common, by_mode = rng.standard_normal(), rng.standard_normal(model.size)
    if tolerances.damping > 1:
        model = replace(model, damping=model.damping.scaled(factors.tolist()))
    if tolerances.frequency > 0:
        # coordinates are modal
        same = first_of_equal(modal_basis(model, model.reference)[0])
        f = np.exp(tolerances.frequency * (common + BY_MODE * by_mode[same]))
        model = replace(model, mass=model.mass.of_all(lambda X: X / np.outer(f, f)))
    if masses:
        added = sum(abs(rng.standard_normal()) * (m @ m.T) for m in masses)
        model = replace(model, mass=replace(model.mass, constant=model.mass.constant + added))
    if tolerances.model > 0 and not modulus_estimated(config):
        model = replace(model, stiffness=model.stiffness.of_all(lambda X: scale * X))
    return model


def _sources(config: PlacementConfig, by_rows: bool) -> list[str]:
    """Sampled errors with σ, in words; by_rows: whether gauges are imported as a strain operator, which cannot be moved."""
    tolerances, moved = tolerances_of(config.tolerances), not by_rows
    damped = [f"factor {tolerances.damping:g} on the damping ratio of every mode"] * (tolerances.damping > 1)
    sources = (
        ("frequency", 100, "natural frequencies {:g} %", True),
        ("load_mass", 100, "mass at each unknown force {:g} % of the structure", _some_unknown_force(config)),
        ("model", 100, "stiffness {:g} %", not modulus_estimated(config)),
        ("position", 1e3, "gauge position {:g} mm per axis", moved),
        ("angle", 1, "gauge angle {:g}°", moved),
        ("gain", 100, "channel gain {:g} %", True),
        ("common_gain", 100, "common gain of all gauges {:g} %", True),
        ("transverse", 100, "transverse sensitivity {:g} %", moved),
        ("mesh", 1, "{:g} times the estimated mesh error of gauges", moved),
        ("offset", 1e6, "channel offset {:g} µm/m", True),
        ("drift", 1e6, "channel drift {:g} µm/m", True),
        ("temperature", 1, "temperature {:g} K", any(installation_std(tolerances).warmed)),
        ("load_angle", 1, "load direction {:g}°", True),
        ("load_position", 1e3, "point of load application {:g} mm", True),
        ("load_gain", 100, "known-load gain {:g} %", _some_known(config)),
    )
    sizes = ((factor * getattr(tolerances, key), words, applies) for key, factor, words, applies in sources)
    return damped + [words.format(size) for size, words, applies in sizes if size > 0 and applies]


def varies(config: PlacementConfig) -> bool:
    """Whether realisations differ."""
    return bool(_sources(config, by_rows=False))


def in_words(config: PlacementConfig, by_rows: bool) -> str:
    """Describe the errors of the truth, beginning with a comma; by_rows: see `_sources`."""
    exact = "gauges in their exact positions, because an imported strain operator cannot be moved"
    sources = _sources(config, by_rows)
    words = [exact] * by_rows + [f"errors sampled with σ: {', '.join(sources)}"] * bool(sources)
    return "".join(f", {text}" for text in words)


def modulus_estimated(config: PlacementConfig) -> bool:
    """Whether a modulus or stiffness factor of the material is estimated; factors of springs or sections and thicknesses do not
    count."""
    named = [config.parameters[name] for name in config.place.estimate if name in config.parameters]
    of_whole = [
        parameter
        for parameter in named
        if of_stiffness(parameter.property) and parameter.property not in (*SECTION_FACTORS, THICKNESS)
    ]
    return any(parameter.springs is None for parameter in of_whole)


SimulatedMotion = Callable[[np.ndarray], np.ndarray]
"""Channels (k,) → readings without noise (T + 1, k) [strain, m/s² or m]."""


@dataclass(frozen=True)
class ModalMotion:
    """Motion in reduced coordinates.

    q, acceleration (T + 1, r); rows (m, r): strain operator; moving (m,): accelerometers; offset (m,), drift (m,) at the end of
    the run [unit of the channel]."""

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
    """Simulated truth.

    theta: true parameters [SI]; limited (gauges,): whether a sharp edge limited the position error; motion: maps a loading to a
    simulated motion; again: maps realisation and gauges to a resampled truth of these gauges, None without sampling; field:
    displacement of all nodes per coordinate of a `ModalMotion` (3 nodes, r), else None."""

    theta: Mapping[str, float]
    description: str
    limited: np.ndarray
    motion: Callable[[Loading], SimulatedMotion]
    again: Callable[[int, np.ndarray], SimulatedTruth] | None = None
    field: Callable[[], np.ndarray] | None = None


def truth_of(structure: Structure, spectrum: Modes | None, problem: Problem, using: Resources) -> SimulatedTruth:
    """Build the truth of the config:

    rom    the filter's own model at the true parameters (an inverse crime; the case of the thesis)
    modes  `modes` modes with static corrections at the true parameters
    perturbed   the same with damping, loads and gauge installation sampled from the tolerances
    full   transient solution of the full finite-element model, gauges in their exact positions

    spectrum: modes valid for all parameter values, used instead of new ones."""
    config, mesh, training, reduced = structure.config, structure.mesh, structure.training, structure.reduced
    settings = config.validation.truth
    theta = {**problem.model.reference, **settings.parameters}
    values = ", ".join(f"{name} = {value:.6g}" for name, value in settings.parameters.items()) or "guessed parameters"
    pool = training.candidates
    if settings.model == "rom":
        rows = training.rows_at(theta)
        words = f"the reduced model of the filter with {values}, without model error (an inverse crime)"
        return _modal(theta, words, np.zeros(pool.gauges, dtype=bool), problem.model, rows, pool)
    parameters = _at(theta, parameters_of(config.parameters, mesh, using.files, config.mesh))
    thickness = thickness_at(mesh, [parameter for parameter in parameters if parameter.property == THICKNESS], theta)
    built = full_model(config.mesh, mesh, parameters, using.files, config.loads, solver_of(config, using))
    modes = built.at_most(settings.modes)
    damping = damping_of(config.damping).scaled(theta.get(problem.model.damping.parameter, 1.0))
    with blame("validate.truth"):
        S = load_shapes(built.model, {name: config.loads[name] for name in problem.model.inputs})
    if settings.model == "full":
        words = f"transient solution of the full finite-element model, {values}"
        return _full(structure, damping, built, S, theta, words, modes, using, thickness)
    loads = point_loads({name: config.loads[name] for name in problem.model.inputs})
    misaligned, static, aside = settings.model == "perturbed" and misaligned_loads(config), reduced.static, None
    if misaligned:
        aside = misalignment_shapes(built.model, list(loads.values())).reshape(len(static), -1)
        static = np.hstack([static, reduced.misaligned.static.reshape(len(static), -1)])
    shapes = None if spectrum is None else Snapshots(spectrum.frequency, built.in_coordinates(spectrum.shape), static)
    with blame("validate.truth.modes"):
        model, basis = modal_model(built.model, S, problem.model.inputs, theta, modes, damping, shapes, aside)
    source = (
        "full model" if built.modes is None else f"imported results ({built.modes} of {settings.modes} modes available)"
    )
    words = f"{modes} modes of the {source} with static corrections, {values}"
    installed = _installed(structure, built, basis, thickness)
    if settings.model == "modes":
        rows, limited = installed(np.arange(pool.gauges), None)
        return replace(_modal(theta, words, limited, model, rows, pool), field=partial(nodal, built.model, basis))
    words += in_words(config, by_rows=training.strain_operator is not None)
    masses: tuple[np.ndarray, ...] = ()
    if structure.tolerances.load_mass > 0 or config.mesh.point_masses:
        turned = misalignment_shapes(built.model, list(loads.values()))[..., :2]
        along = np.einsum("ia,iuk->auk", basis, turned)
        masses = load_mass_errors(structure, model.input_shape, along)
        masses += point_mass_errors(structure, nodal(built.model, basis))

    def sample(realisation: int, gauges: np.ndarray) -> SimulatedTruth:
        installation = installation_of(config, pool, realisation).take(pool, gauges)
        with blame("tolerances"):
            rows, limited = installed(gauges, installation)
        sampled, part = model_of(config, model, realisation, masses), pool.take(pool.channels(gauges))
        if misaligned_loads(config) or (_some_known(config) and structure.tolerances.load_gain > 0):
            sampled = sampled.acted_on(basis.T @ _loaded(config, built.model, loads, problem.known, realisation))
        truth = _modal(theta, words, limited, sampled, rows, part, installation)
        return replace(truth, field=partial(nodal, built.model, basis))

    return replace(sample(0, np.arange(pool.gauges)), again=sample if varies(config) else None)


def _loaded(
    config: PlacementConfig,
    model: FiniteElementModel,
    loads: Mapping[str, PointLoad],
    known: Sequence[str],
    realisation: int,
) -> np.ndarray:
    """Input shape (n_free, n_u) of the loads in one realisation."""
    columns = []
    for name, load in loads.items():
        off = load_error_of(config, name, name in known, realisation)
        columns.append(off.factor * misaligned_shape(model, load, off.turn, off.shift))
    return np.column_stack(columns)


Installed = Callable[[np.ndarray, Installation | None], tuple[np.ndarray, np.ndarray]]


def _installed(structure: Structure, built: FullModel, basis: np.ndarray, thickness: Thickness | None) -> Installed:
    """Return a function: gauges (k,) and installation (None: nominal) → strain operator (m, r), and whether an edge limits each.
    An imported strain operator has gain errors only."""
    training, pool, position = structure.training, structure.pool, structure.mesh.position
    if training.strain_operator is not None:
        strain_operator = training.strain_operator @ (built.motion @ basis)

        def scaled(gauges: np.ndarray, installation: Installation | None) -> tuple[np.ndarray, np.ndarray]:
            gain = 0.0 if installation is None else installation.gain[:, None]
            return (1 + gain) * strain_operator[pool.channels(gauges)], np.zeros(len(gauges), dtype=bool)

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
    limited: np.ndarray,
    model: ReducedModel,
    rows: np.ndarray,
    pool: Candidates,
    installation: Installation | None = None,
) -> SimulatedTruth:
    # evaluates the filter's own model at the true parameters, which are the reference of any other model
    at = {name: theta[name] for name in model.reference}
    exact = np.zeros(len(pool))
    zero = (exact, exact) if installation is None else (installation.offset, installation.drift)

    def motion(loading: Loading) -> SimulatedMotion:
        x = motion_of(model, at, loading)
        a = accelerations(model, at, x, instant_values(loading.coefficients))
        return ModalMotion(x[:, : model.size], a, rows, pool.quantity == ACCELERATION, *zero)

    return SimulatedTruth(theta, words, limited, motion)


def _full(
    structure: Structure,
    damping: Damping,
    built: FullModel,
    S: np.ndarray,
    theta: Mapping[str, float],
    words: str,
    modes: int,
    using: Resources,
    thickness: Thickness | None,
) -> SimulatedTruth:
    """Truth by a transient solution; modes: number of modes with the modal damping ratio."""
    # solvers only needed here
    from strainsight.fem.factorisation import relief_of
    from strainsight.fem.transient import ViscousDamping, free_rows, modal_damping, steady_state, transient

    K, M = built.model.stiffness.at(theta), built.model.mass.at(theta)
    if built.model.rigid is not None:
        S = relief_of(M, built.model.rigid).balance(S)  # gauges do not measure rigid-body motion
    if damping.kind == "modal":
        viscous = modal_damping(K, M, damping.ratio, modes, rigid=built.model.rigid)
    else:
        viscous = ViscousDamping(damping.alpha, damping.beta)
    training, pool = structure.training, structure.pool
    if training.strain_operator is not None:
        assert built.motion is not None
        rows = sparse.csr_array(training.strain_operator @ built.motion)
    else:
        rows = free_rows(built.model, channel_matrix(structure.mesh.position, pool, structure.skin.facets, thickness))
    moving = pool.quantity == ACCELERATION

    def motion(loading: Loading) -> SimulatedMotion:
        tones, lead = loading.tones, len(loading.lead)
        with blame("validate.truth"):
            run = transient(
                built.model,
                S,
                theta,
                viscous,
                np.concatenate([loading.lead, loading.coefficients]),
                loading.h,
                rows[np.flatnonzero(~moving)],
                rows[np.flatnonzero(moving)] if moving.any() else None,
                start=None if tones is None else steady_state(K, M, S, viscous, tones.frequency, tones.amplitude),
                progress=lambda share: using.progress("simulated test", 0.2 * share),
            )
        readings = np.empty((len(loading.coefficients) + 1, len(moving)))
        readings[:, ~moving], readings[:, moving] = run.reading[lead:], run.acceleration[lead:]
        return lambda channels: readings[:, channels]

    return SimulatedTruth(theta, words, np.zeros(pool.gauges, dtype=bool), motion)


def _at(theta: Mapping[str, float], parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
    return at_their_references([replace(p, reference=theta[p.name]) for p in parameters])
