"""Estimation problem of placement, validation and estimate: unknowns, process noise, and filter model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.errors import blame
from strainsight.estimation.consistency import load_scale
from strainsight.estimation.model import FilterModel
from strainsight.estimation.record import Settled
from strainsight.estimation.update import Form
from strainsight.experiment.structure.candidates import CandidateChannels, channels_of, of_channels
from strainsight.experiment.structure.references import unknowns_of
from strainsight.experiment.structure.start import Loading, motion_of
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.training import TrainingRun, run_as_stated, typical_of
from strainsight.loads.histories import instant_values
from strainsight.loads.input_models import WALK, Unknowns
from strainsight.loads.linearisation import (
    Rule,
    channel_intensity,
    linearisation_instants,
    linearise,
    process_intensity,
)
from strainsight.placement.scenario import Scenario
from strainsight.records.training import Screened
from strainsight.rom.modal_step import Scheme, hold_of_tones, scheme_bias
from strainsight.rom.model import ReducedModel, accelerations, modal_basis
from strainsight.sensors.candidates import STRAIN

REST_SHARE = 1e-3
"""Initial σ of every state relative to its largest training amplitude, for a start at rest or in periodic motion."""


Method = Literal["grid", "extended", "sigma-point"]
SILENT = 1e12
"""Factor on the noise intensity of a channel that removes its information."""


@dataclass(frozen=True)
class Problem:
    """Estimation problem before gauges are chosen.

    run, x (steps + 1, 2n), loading: training simulation; Q (n*, n*): process intensity of the filter, frozen_Q: of the placement;
    printed: whether the printed numbers of the thesis are reproduced; channels: of all candidates; scheme, form, iterations: of
    the extended filter; method: of the filter; drifting: whether parameters drift or are constants."""

    model: ReducedModel
    unknowns: Unknowns
    run: TrainingRun
    x: np.ndarray
    loading: Loading
    Q: np.ndarray
    frozen_Q: np.ndarray
    printed: bool
    channels: CandidateChannels
    scheme: Scheme
    form: Form
    iterations: int
    method: Method
    drifting: bool

    @property
    def u(self) -> np.ndarray:
        """Hold coefficients (steps, HOLD, n_u) [N] of the training simulation."""
        return self.loading.coefficients

    @property
    def h(self) -> float:
        """Step [s] of the training simulation."""
        return self.loading.h

    @property
    def acts(self) -> np.ndarray:
        """Whether each unknown acts in the run (u,); inactive loads do not."""
        return np.array([name not in self.run.silent for name in self.unknowns.names])

    @property
    def reference(self) -> np.ndarray:
        """Reference of the relative σ of every unknown (u,) [SI]: RMS of a load in the training simulation, guess of a
        parameter."""
        unknowns, u = self.unknowns, instant_values(self.u)
        loads = (load_scale(u[:, self.columns([name])[0]], unknowns.amplitude[name])[0] for name in unknowns.inputs)
        size = {**unknowns.guess, **dict(zip(unknowns.inputs, loads, strict=True))}
        return np.array([size[name] for name in unknowns.names])

    @property
    def known(self) -> tuple[str, ...]:
        """Names of the known loads."""
        return tuple(name for name in self.model.inputs if name not in self.unknowns.inputs)

    def columns(self, names: Sequence[str]) -> list[int]:
        return [self.model.inputs.index(name) for name in names]


def problem_of(structure: Structure, screened: Screened, run: TrainingRun | None = None) -> Problem:
    """Set up the estimation problem; run: None for the configured loads.

    The noise applies to samples at train.time_step; other time steps keep the same intensity."""
    config, files, model = structure.config, structure.files, structure.reduced.model
    run = run or run_as_stated(config, model.inputs, files)
    h, motion, loading = run.time_step, structure.training.motion_in(run.name), run.loading()
    x = np.hstack([motion.coordinate, motion.velocity])
    inputs = tuple(name for name in config.place.estimate if name in config.loads)
    typical = typical_of(config, run, inputs, files)
    unknowns = unknowns_of(config.place.estimate, config.loads, typical, model.reference)
    rule = config.process_noise.rule
    rules: tuple[Rule, Rule] = (
        ("intensity", "intensity")
        if rule == "continuous"
        else ("as_printed" if rule == "as_printed" else "thesis", "thesis")
    )
    with blame("process_noise"):
        frozen_Q, Q = (
            process_intensity(
                model.size,
                unknowns,
                {name: typical[name][0] for name in unknowns.inputs},
                {name: config.parameters[name].process_noise_scale for name in unknowns.parameters},
                rule=one,
                h=h,
                kappa=np.array([config.loads[name].process_noise.kappa or WALK for name in unknowns.inputs]),
                velocity=model_error_intensity(model, x, loading.coefficients[:, 0], share),
            )
            for one, share in zip(rules, _model_error(config, unknowns), strict=True)
        )
    channels = channels_of(structure.training, screened)
    if h != config.train.time_step:
        channels = replace(channels, noise_std=channels.noise_std * np.sqrt(config.train.time_step / h))
    settings = config.filter
    drifting = settings.method == "extended" if settings.drift is None else settings.drift
    if not drifting:
        constant = range(len(Q) - len(unknowns.parameters), len(Q))
        Q[constant, constant] = 0.0
    return Problem(
        model,
        unknowns,
        run,
        x,
        loading,
        Q,
        frozen_Q,
        rule == "as_printed",
        channels,
        settings.scheme,
        settings.form,
        settings.iterations,
        settings.method,
        drifting,
    )


MODEL_ERROR = 0.01
"""Default noise on the velocities, relative to the RMS acceleration."""


def _model_error(config: PlacementConfig, unknowns: Unknowns) -> tuple[float, float]:
    """Share of the training acceleration that is noise in the placement, and in the filter.
    The parameter grid filter with a damping tolerance needs none; this noise would bias its parameters."""
    model_error = config.process_noise.model_error
    if model_error is not None:
        return model_error, model_error
    tolerant = tolerances_of(config.tolerances).damping > 1
    by_grid = config.filter.method == "grid" and bool(unknowns.parameters)
    return MODEL_ERROR, 0.0 if by_grid and tolerant else MODEL_ERROR


def model_error_intensity(model: ReducedModel, x: np.ndarray, u: np.ndarray, share: float) -> np.ndarray:
    """q_v = (share · rms q̈)² / ω₁ (n,) [kg m²/s³]: white acceleration noise for model errors.

    share [-]: of the RMS training acceleration, correlated over 1/ω₁ of the first mode; x (T + 1, 2n); u (T, n_u) [N]."""
    acceleration = accelerations(model, model.reference, x[: len(u)], u)
    lam, _ = modal_basis(model, model.reference)
    return share**2 * np.mean(acceleration**2, axis=0) / np.sqrt(lam[0])


def filter_model(
    problem: Problem,
    channels: np.ndarray,
    h: float,
    noise_factor: float | np.ndarray = 1.0,
    sigma: np.ndarray | None = None,
) -> FilterModel:
    """Filter model of channels (k,) or (B, k), rows of train.h5, −1 for none, at time step h [s].

    noise_factor: scalar or (B,); sigma (k,): σ of a sample at problem.h, NaN for the default. Unknown loads are unconstrained if
    another load is known. Otherwise, and for a damping factor, only their random-walk model separates them from parameters."""
    every = problem.channels
    rows = of_channels(every.rows, channels)
    quantity = np.where(channels >= 0, every.quantity[channels], STRAIN)
    std = every.noise_std[channels] if sigma is None else np.where(np.isnan(sigma), every.noise_std[channels], sigma)
    std = np.asarray(noise_factor)[..., None] * std
    H = np.concatenate(
        [rows, np.zeros((*channels.shape, problem.unknowns.size(problem.model) - rows.shape[-1]))], axis=-1
    )
    r = channel_intensity(std, problem.h, rows, quantity, problem.Q)
    fixed = {name: value for name, value in problem.model.reference.items() if name not in problem.unknowns.parameters}
    return FilterModel(
        problem.model,
        problem.unknowns,
        problem.known,
        fixed,
        H,
        problem.Q,
        r,
        h,
        quantity,
        problem.scheme,
        change=every.change.of_terms(lambda X: of_channels(X, channels)),
        free_loads=bool(problem.known) and problem.model.damping.parameter not in problem.unknowns.parameters,
    )


def exactly_damped(problem: Problem, model: FilterModel) -> FilterModel:
    """Filter model with exact damping and the additional noise on velocities and accelerometers that this requires."""
    n, Q = model.model.size, model.Q.copy()
    moving = slice(n, 2 * n)
    more = problem.frozen_Q[moving, moving] - Q[..., moving, moving]
    Q[..., moving, moving] += more
    if model.accelerometers is None:
        return replace(model, Q=Q)
    shape = model.H[..., :n]
    sensed = np.einsum("...i,...ij,...j->...", shape, more, shape)
    return replace(model, Q=Q, r=model.r + np.where(model.accelerometers, sensed, 0.0))


def load_dependence_text(problem: Problem) -> str:
    """Warning that parameters depend on the noise model of the unknown loads; empty if a load is known.

    Without a known load, a different size or speed of the loads explains the readings as well (docs/measured.md, Coverage)."""
    unknowns = problem.unknowns
    if problem.known or not unknowns.inputs or not unknowns.parameters:
        return ""
    names, loads = ", ".join(unknowns.parameters), ", ".join(unknowns.inputs)
    return (
        f"no load is known, so the estimates of {names} depend on the process_noise of {loads}, and σ is invalid for other "
        "loads. Measure one load and set loads.*.known: true for this load"
    )


def damping_dependence_text(problem: Problem) -> str:
    """Warning that parameters depend on the load noise model because a damping factor is estimated, too; else empty."""
    unknowns, damping = problem.unknowns, problem.model.damping.parameter
    others = [name for name in unknowns.parameters if name != damping]
    if not problem.known or not unknowns.inputs or not others or damping not in unknowns.parameters:
        return ""
    return (
        f"the damping factor {damping} is also unknown, so σ of {', '.join(others)} depends on the process_noise of "
        f"{', '.join(unknowns.inputs)}. Remove {damping} from place.estimate to make σ independent of process_noise"
    )


def scheme_in_words(problem: Problem, h: float) -> str:
    """Period and damping error of the first mode by the time step of the filter; empty if it is exact."""
    if problem.scheme == "exact":
        return ""
    model, at = problem.model, problem.model.reference
    bias = scheme_bias(modal_basis(model, at)[0], model.damping.at(at), h, problem.scheme)
    longer, damped = (values[0] for values in bias)
    return (
        f"the {problem.scheme.replace('_', ' ')} scheme with a time step of {h:g} s increases the period of the first mode "
        f"by {100 * longer:.2g} % (error of a modulus: {200 * longer:.2g} %) and adds {damped:.2g} to its damping ratio. "
        "Reduce the time step, or set filter.scheme: exact"
    )


def sample_std(problem: Problem, channels: np.ndarray, h: float, noise_factor: float | np.ndarray = 1.0) -> np.ndarray:
    """σ of one sample at time step h [s] of channels (k,) or (B, k) [unit of the channel], 1 for channel −1."""
    noise_std = problem.channels.noise_std[channels] * np.sqrt(problem.h / h)
    return np.where(channels >= 0, np.asarray(noise_factor)[..., None] * noise_std, 1.0)


def settled_under(problem: Problem, loading: Loading) -> Settled | None:
    """Periodic initial motion for the parameter grid filter if all loads are known and periodic, else None."""
    tones = loading.tones
    if tones is None or problem.unknowns.inputs or problem.method != "grid":
        return None
    known = tones.amplitude[:, problem.columns(problem.known)]
    return settled_at(problem, tones.frequency, hold_of_tones(tones.frequency, loading.h)[..., None] * known[:, None])


def settled_at(problem: Problem, frequency: np.ndarray, amplitude: np.ndarray) -> Settled:
    """Periodic motion with σ by REST_SHARE; frequency (k,) [rad/s], amplitude (k, HOLD, n_known) complex [N]."""
    return Settled(frequency, amplitude, REST_SHARE * np.abs(problem.x).max(axis=0))


def initial_covariance(problem: Problem, relative_std: Mapping[str, float], moving: bool) -> np.ndarray:
    """P₀ (n*, n*): σ of unknowns relative to amplitude or guess; σ of states by REST_SHARE, or for an unknown motion by the
    largest training amplitude."""
    unknowns = problem.unknowns
    std = np.zeros(unknowns.size(problem.model))
    std[: problem.x.shape[1]] = (1.0 if moving else REST_SHARE) * np.abs(problem.x).max(axis=0)
    # derivatives of the inputs are unknown at first and of order one
    std[problem.x.shape[1] :] = 1.0
    std[unknowns.position(problem.model)] = [relative_std[name] for name in unknowns.names]
    return np.diag(std**2)


def scenarios_of(
    problem: Problem, channels: np.ndarray, config: PlacementConfig, installation: np.ndarray | None = None
) -> tuple[Scenario, ...]:
    """One linearisation per instant and parameter sample, without a metric yet.

    channels (pool, c): rows of train.h5 of every pool row, −1 for none; installation (m,) [unit² s]: intensity added to the noise
    of every channel of train.h5 (`installation_variances`)."""
    p, settings = problem, config.place
    ranges = {name: entry.range for name, entry in config.parameters.items()}
    u = instant_values(p.u)
    plain: list[Scenario] = []
    for theta in parameter_samples(p.model.reference, ranges, settings.parameter_samples, config.seed):
        x = p.x if theta == p.model.reference else motion_of(p.model, theta, p.loading)
        chosen = placed_instants(p, theta, x, config)
        F = linearise(p.model, p.unknowns, theta, x[chosen], u[chosen], settings.damping_slope)
        for F_at, H, r in zip(F, *_measured(p, channels, theta, x[chosen], u[chosen], F, installation), strict=True):
            plain.append(Scenario(F_at, p.frozen_Q, H, r, np.zeros(len(F_at))))
    return tuple(plain)


def placed_instants(problem: Problem, theta: Mapping[str, float], x: np.ndarray, config: PlacementConfig) -> np.ndarray:
    """Indices of the instants to place for, in the motion x (steps + 1, 2n) at θ [SI]."""
    # a single instant may be any, as in the thesis, even if a parameter hardly acts
    count = config.place.instants
    share, u = 0.0 if count == 1 else 0.5, instant_values(problem.u)
    return linearisation_instants(problem.model, problem.unknowns, theta, x, u, count, config.seed, share)


def parameter_samples(
    reference: Mapping[str, float], ranges: Mapping[str, Sequence[float]], count: int, seed: int
) -> list[dict[str, float]]:
    """The guess, then count − 1 points of a scrambled Halton sequence in the ranges; name → value [SI]."""
    names = sorted(reference)
    if count == 1 or not names:
        return [dict(reference)]
    from scipy.stats import qmc  # slow to import

    low, high = (np.array([float(ranges[name][end]) for name in names]) for end in (0, 1))
    points = low + (high - low) * qmc.Halton(len(names), seed=seed).random(count - 1)
    return [dict(reference), *({n: float(v) for n, v in zip(names, row, strict=True)} for row in points)]


def _measured(
    problem: Problem,
    channels: np.ndarray,
    theta: Mapping[str, float],
    x: np.ndarray,
    u: np.ndarray,
    F: np.ndarray,
    installation: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """H* (s, pool, c, n*) and r (s, pool, c) at s instants, without axis c if every pool row has one channel."""
    every, exists = problem.channels, channels >= 0
    used = np.unique(channels[exists])
    sensed = every.sensed(used)
    rule: Rule = "as_printed" if problem.printed else "intensity"
    H = sensed.linearised(problem.model, problem.unknowns, theta, x, u, F)
    r = channel_intensity(every.noise_std[used], problem.h, sensed.rows, sensed.quantity, problem.frozen_Q, rule)
    r = r if installation is None else r + installation[used]
    at = np.searchsorted(used, channels)
    at[~exists] = 0
    blocks, intensity = np.where(exists[..., None], H[:, at], 0.0), np.broadcast_to(r[at], (len(F), *at.shape))
    return (blocks[:, :, 0], intensity[:, :, 0]) if channels.shape[1] == 1 else (blocks, intensity)
