"""Screening of candidates for the placement (5.2) by the signal-to-noise ratio of each unknown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from strainsight.config.gauges import AbsoluteNoise, RelativeNoise
from strainsight.config.placement import PlacementConfig, Screen
from strainsight.errors import ConfigError, InfeasibleError, blame
from strainsight.experiment.structure.clearance import bent_gauges, clearance_of
from strainsight.experiment.structure.exclusions import excluded_gauges
from strainsight.experiment.structure.references import families
from strainsight.experiment.structure.start import Loading, motion_of
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.training import TrainingRun, refuse_noise
from strainsight.loads.histories import instant_values
from strainsight.records.training import Screened
from strainsight.rom.model import ReducedModel, accelerations
from strainsight.sensors.candidates import ACCELERATION, Candidates
from strainsight.sensors.installation import installation_variance
from strainsight.sensors.screening import BEND, CLEARANCE, Screening, screen

COHERENCE = 0.01
"""Correlation time of the white noise that replaces installation errors, relative to the training simulation. If these
errors exceed the noise of a gauge, its value hardly changes the layout."""
AT_A_TIME = 4000
"""Gauges whose sensitivities are in memory at a time."""


def avoids_errors(config: PlacementConfig) -> bool:
    """Whether screening and placement avoid installation errors."""
    return config.place.installation == "avoid" and config.process_noise.rule != "as_printed"


def installation_variances(structure: Structure, gauges: np.ndarray) -> np.ndarray:
    """Mean-square effect of installation errors on the training readings at the guess:

        v_j of `installation_variance`,     C = mean_t q qᵀ + Σₖ mean_t qₖ qₖᵀ

    qₖ: motion added by one σ of a load misalignment, with its part outside the reduced basis appended in proportion to the load.
    White noise of variance v correlated over τ has the intensity τ v. Correlation between channels of a gauge is neglected.
    gauges: ascending. Returns (cases, m) [unit²] for all channels in every load case, (1, m) without cases; zero for gauges that
    are not requested."""
    pool, std = structure.pool, structure.installation
    moments = [_moments(structure, run) for run in structure.runs]
    v = np.zeros((len(moments), len(pool)))
    for few in np.array_split(gauges, len(gauges) // AT_A_TIME + 1):
        index = pool.channels(few)
        slopes, part = structure.sensitivity(index), pool.take(index)
        v[:, index] = [installation_variance(slopes, std, part, still, moving) for still, moving in moments]
    return v


def _moments(structure: Structure, run: TrainingRun) -> tuple[np.ndarray, np.ndarray]:
    """C of [q, static residual], and of the accelerations, which have no residual."""
    n, motions = structure.reduced.model.size, list(_motions(structure, run))
    load = structure.training.motion_in(run.name).load[: len(motions[0][1])]
    z = np.vstack([np.hstack([x[:, :n], missed.reshape(len(x), -1)]) for _, x, missed in motions])
    a = np.vstack([accelerations(model, model.reference, x, load) for model, x, _ in motions])
    return z.T @ z / len(load), np.pad(a.T @ a / len(load), (0, z.shape[1] - n))


def _motions(structure: Structure, run: TrainingRun) -> Iterator[tuple[ReducedModel, np.ndarray, np.ndarray]]:
    """Yield model, x (T + 1, 2n) and static residual (T + 1, n_u, misalignments) [N rad or N m] of the training
    simulation, and of one σ of every misalignment."""
    reduced, motion = structure.reduced, structure.training.motion_in(run.name)
    tolerances, off = structure.tolerances, reduced.misaligned
    std = np.repeat([np.deg2rad(tolerances.load_angle), tolerances.load_position], 2)
    nothing = np.zeros((len(motion.load), *off.missed.shape[1:]))
    yield reduced.model, np.hstack([motion.coordinate, motion.velocity]), nothing
    loading = run.loading()
    for i, way in np.argwhere((off.shape.any(axis=0) | off.missed.any(axis=0)) & (std > 0)):
        shape, missed = np.zeros_like(reduced.model.input_shape), nothing.copy()
        shape[:, i], missed[:, i, way] = std[way] * off.shape[:, i, way], std[way] * motion.load[:, i]
        model = reduced.model.acted_on(shape)
        yield model, motion_of(model, model.reference, loading), missed


STEP = 1e-4
"""Step of the central difference in ln θ."""


def screened_of(structure: Structure) -> Screened:
    """Exclude unsuitable places, apply the clearance, set the noise, drop overloaded channels, take the best for each unknown in
    every load case, and thin clusters."""
    config, training, pool = structure.config, structure.training, structure.pool
    rms = training.rms
    noise_std, limit = np.empty(len(rms)), np.full(len(rms), np.inf)
    bent = bent_gauges(structure) & ~pool.bonded[pool.first]
    excluded = excluded_gauges(structure)
    clearance, near = clearance_of(structure, excluded != "")
    near |= bent | (excluded != "")
    clear = ~near[pool.gauge]
    best = {}
    for i, (key, family) in enumerate(families(config).items()):
        of_family = pool.array == i
        # bonded gauges and singular corners must not raise the noise of all others
        free = of_family & ~pool.bonded & clear if (of_family & ~pool.bonded).any() else of_family
        noise_std[of_family] = _noise_std(family.noise_std, rms[free], f"{key}.noise_std")
        if of_family.any():
            best[key] = float(rms[of_family].max()), float(noise_std[of_family][0])
        if family.range is not None:
            limit[of_family] = family.range
    refuse_noise(best)
    v = None
    if avoids_errors(config):
        v = installation_variances(structure, np.flatnonzero(~near))
    if config.screen.by == "strength":
        ratio = training.rms_in_cases / noise_std
    else:
        ratio = _by_unknowns(structure, noise_std, v)
    with blame("screen.keep"):
        result = _screened(config.screen, pool, near, ratio, training.strained, limit)
    return Screened(
        kept=result.kept,
        snr=result.snr,
        reason=np.where(excluded != "", excluded, np.where(bent, BEND, np.asarray(result.reason, dtype=np.str_))),
        clearance=clearance,
        noise_std=noise_std,
        installation=v,
        range=limit,
        family=tuple(key.removeprefix("motion_sensors.") for key in families(config)),
    )


def _screened(
    settings: Screen, pool: Candidates, near: np.ndarray, ratio: np.ndarray, strained: np.ndarray, limit: np.ndarray
) -> Screening:
    """Screen every kind of sensor separately.
    ratio (k, m) [-]: signal-to-noise ratios, used in turn; near (gauges,): violates the clearance; strained (m,): largest reading
    of any grid of a channel."""
    keep = None if settings.keep == "all" else settings.keep
    kinds = pool.array[pool.first]
    selected, reason = [], np.full(pool.gauges, CLEARANCE, dtype="<U9")
    snr = np.max([np.sqrt(np.bincount(pool.gauge, of_unknown**2, pool.gauges)) for of_unknown in ratio], axis=0)
    for kind in np.unique(kinds):
        gauges = np.flatnonzero((kinds == kind) & ~near)
        channels = np.flatnonzero((pool.array == kind) & ~near[pool.gauge])
        part = pool.take(channels)
        screening = screen(
            ratio[:, channels],
            1.0,
            pool.position[channels],
            keep,
            settings.minimum_spacing,
            gauge=np.searchsorted(gauges, pool.gauge[channels]),
            bonded=pool.bonded[channels],
            largest=strained[channels],
            limit=limit[channels],
            also_at=None if part.arms is None else (part.arms.grid.position, part.gauge[part.arms.channel]),
        )
        selected.append(gauges[screening.kept])
        snr[gauges], reason[gauges] = screening.snr, screening.reason
    return Screening(np.sort(np.concatenate(selected)), snr, reason)


def _by_unknowns(structure: Structure, noise_std: np.ndarray, v: np.ndarray | None) -> np.ndarray:
    """Signal-to-noise ratios (k, m) of each unknown in every load case, relative to σ, and if installation errors are avoided
    also to

        √(σ² + τ v/h)

    v (cases, m): see `installation_variances`. A placement solves for both, and at a tenth of τ. Raises InfeasibleError if
    no unknown affects any channel."""
    alone, config = list(_alone(structure)), structure.config
    if not alone:
        raise InfeasibleError(
            "in the training simulation (stage `train`), no reading of a candidate depends on "
            f"{' or '.join(config.place.estimate)}",
            key="place.estimate",
            remedy="Use training loads that excite these unknowns, for example a recorded signal that is not zero.",
        )
    ratio = [rms / noise_std for _, rms in alone]
    if v is not None:
        tau = np.array([COHERENCE * motion.time[-1] for motion in structure.training.motions])
        std = np.sqrt(noise_std**2 + tau[:, None] * v / config.train.time_step)
        ratio += [rms / std[case] for case, rms in alone]
    return np.array(ratio).reshape(-1, len(noise_std))


def _alone(structure: Structure) -> Iterator[tuple[int, np.ndarray]]:
    """Yield load case and RMS reading over time (m,) for each unknown that acts in it: under a load alone, or of θ ∂y/∂θ of a
    parameter by a central difference."""
    model, training = structure.reduced.model, structure.training
    sensing, inputs = structure.pool.quantity == ACCELERATION, model.inputs
    for case, run in enumerate(structure.runs):
        loading = run.loading()
        for name in structure.config.place.estimate:
            if name in inputs:
                alone = model.acted_on(model.input_shape * (np.array(inputs) == name))
                rms = _rms(training.rows, sensing, _motion(alone, model.reference, loading))
            else:
                more, less = (
                    _motion(model, {**model.reference, name: way * model.reference[name]}, loading)
                    for way in (1 + STEP, 1 - STEP)
                )
                difference = [(a - b) / (2 * STEP) for a, b in zip(more, less, strict=True)]
                rows = training.rows
                if name in training.change.parameters:
                    slope = model.reference[name] * training.change.derivative(name, model.reference)
                    rows = np.hstack([rows, slope])
                    motion = _motion(model, model.reference, loading)
                    difference = [np.hstack(both) for both in zip(difference, motion, strict=True)]
                rms = _rms(rows, sensing, difference)
            if rms.any():
                yield case, rms


def _motion(model: ReducedModel, theta: Mapping[str, float], loading: Loading) -> Sequence[np.ndarray]:
    """Displacement q and acceleration q̈ (T, n) under the loads."""
    x, u = motion_of(model, theta, loading), instant_values(loading.coefficients)
    return x[:, : model.size], accelerations(model, theta, x, u)


def _rms(rows: np.ndarray, sensing: np.ndarray, motion: Sequence[np.ndarray]) -> np.ndarray:
    """RMS of every channel (m,) as ‖R rᵀ‖/√T with q = QR; for accelerometers (`sensing` (m,)) of q̈."""
    still, moving = (np.linalg.qr(history, mode="r") / np.sqrt(len(history)) for history in motion)
    rms = np.linalg.norm(rows @ still.T, axis=1)
    rms[sensing] = np.linalg.norm(rows[sensing] @ moving.T, axis=1)
    return np.asarray(rms)


def _noise_std(noise: AbsoluteNoise | RelativeNoise, rms: np.ndarray, key: str) -> float:
    """σ of a family of sensors: absolute, or relative to its strongest candidate."""
    if isinstance(noise, AbsoluteNoise):
        return noise.value
    strongest = float(rms.max())
    if strongest <= 0:
        raise ConfigError(
            "relative noise is undefined because all readings are zero in the training simulation (stage `train`)",
            key=key,
            remedy=f"Set {key}: {{value: …}}, or use loads that strain the structure.",
        )
    return noise.relative_to_strongest * strongest
