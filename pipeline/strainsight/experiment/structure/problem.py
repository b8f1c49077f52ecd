"""What place and validate share: the unknowns, their process noise, and the filter's model of a set of gauges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.errors import blame
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
"""Initial σ of every state as a share of its largest training amplitude, where the structure is known to be at rest or in the
periodic motion under its loads."""


Method = Literal["bank", "extended", "sigma-point"]
SILENT = 1e12
"""Factor on a channel's noise intensity that makes it say nothing."""


@dataclass(frozen=True)
class Problem:
    """One estimation problem before its gauges are chosen.

    model; unknowns; run: the training run, with its motion x (steps + 1, 2n) and loading; Q (n*, n*) process intensity of the
    filter, frozen_Q that of the placement, which differs where the thesis's printed numbers are asked for; printed: whether they
    are; channels of all candidates; scheme of the time step, form of the covariance and iterations of the update of the extended
    filter; method of the filter; drifting: whether parameters drift in it, or are constants.
    """

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
        """Hold coefficients (steps, HOLD, n_u) [N] of the training run."""
        return self.loading.held

    @property
    def h(self) -> float:
        """Step [s] of the training run."""
        return self.loading.h

    @property
    def acts(self) -> np.ndarray:
        """Which unknowns act in the run (u,) bool: all but its silent loads."""
        return np.array([name not in self.run.silent for name in self.unknowns.names])

    @property
    def known(self) -> tuple[str, ...]:
        """Inputs whose history the filter is given."""
        return tuple(name for name in self.model.inputs if name not in self.unknowns.inputs)

    def columns(self, names: Sequence[str]) -> list[int]:
        return [self.model.inputs.index(name) for name in names]


def problem_of(structure: Structure, screened: Screened, run: TrainingRun | None = None) -> Problem:
    """Gather the estimation problem from the reduced model, a training run, the noise of the channels and the config.

    run: None: that under the loads as stated. Noise is that of a sample every train.time_step: in a run of another step it is
    that of the same intensity.
    """
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
                velocity=model_error_intensity(model, x, loading.held[:, 0], share),
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
"""Noise on the velocities where the config gives none."""


def _model_error(config: PlacementConfig, unknowns: Unknowns) -> tuple[float, float]:
    """Share of the training acceleration that is noise in the layout, and in the filter.

    A grid filter over parameters whose damping has a tolerance needs none, and is misled by it: readings that are quieter than
    the noise says speak for parameters at which the same noise makes quieter readings.
    """
    stated = config.process_noise.model_error
    if stated is not None:
        return stated, stated
    tolerant = tolerances_of(config.tolerances).damping > 1
    uses_grid = config.filter.method == "bank" and bool(unknowns.parameters)
    return MODEL_ERROR, 0.0 if uses_grid and tolerant else MODEL_ERROR


def model_error_intensity(model: ReducedModel, x: np.ndarray, u: np.ndarray, share: float) -> np.ndarray:
    """q_v = (share · rms q̈)² / ω₁ (n,) [kg m²/s³]: a white acceleration for what the model leaves out.

    share [-] of the RMS training acceleration, correlated over 1/ω₁ of the first mode; x (T + 1, 2n); u (T, n_u) [N].
    """
    acceleration = accelerations(model, model.reference, x[: len(u)], u)
    lam, _ = modal_basis(model, model.reference)
    return share**2 * np.mean(acceleration**2, axis=0) / np.sqrt(lam[0])


def filter_model(
    problem: Problem,
    channels: np.ndarray,
    h: float,
    noise_factor: float | np.ndarray = 1.0,
    stated: np.ndarray | None = None,
) -> FilterModel:
    """The filter with these channels at step h [s]: channels (k,) or (B, k) rows of train.h5, −1 for none, which reads
    nothing; noise_factor scalar or (B,); stated (k,): σ of a sample every problem.h, NaN where that of the pool holds.

    Unknown loads are free beside a known one. Without one nothing tells parameters from them but how they move as stated, and a
    damping is seen by small differences of phase, which noise of free loads would blur.
    """
    every = problem.channels
    rows = of_channels(every.rows, channels)
    quantity = np.where(channels >= 0, every.quantity[channels], STRAIN)
    std = every.noise_std[channels] if stated is None else np.where(np.isnan(stated), every.noise_std[channels], stated)
    std = np.asarray(noise_factor)[..., None] * std
    H = np.concatenate(
        [rows, np.zeros((*channels.shape, problem.unknowns.size(problem.model) - rows.shape[-1]))], axis=-1
    )
    r = channel_intensity(std, problem.h, rows, quantity, problem.Q)
    fixed = {name: value for name, value in problem.model.reference.items() if name not in problem.unknowns.parameters}
    change = every.change.of_terms(lambda X: of_channels(X, channels))
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
        change=change,
        free_loads=bool(problem.known) and problem.model.damping.parameter not in problem.unknowns.parameters,
    )


def exactly_damped(problem: Problem, model: FilterModel) -> FilterModel:
    """The model of a filter that takes the damping for exact, with the noise on the velocities that this asks for, and that on
    accelerometers."""
    n, Q = model.model.size, model.Q.copy()
    moving = slice(n, 2 * n)
    more = problem.frozen_Q[moving, moving] - Q[..., moving, moving]
    Q[..., moving, moving] += more
    if model.accelerometers is None:
        return replace(model, Q=Q)
    shape = model.H[..., :n]
    sensed = np.einsum("...i,...ij,...j->...", shape, more, shape)
    return replace(model, Q=Q, r=model.r + np.where(model.accelerometers, sensed, 0.0))


def rests_on_loads_in_words(problem: Problem) -> str:
    """What parameters owe to how the unknown loads are modelled, where no load is known; empty where one is.

    Without a known load a parameter is seen by how large and how fast the readings are alone, which a load of another size and
    speed explains as well (docs/measured.md, Coverage).
    """
    unknowns = problem.unknowns
    if problem.known or not unknowns.inputs or not unknowns.parameters:
        return ""
    names, loads = ", ".join(unknowns.parameters), ", ".join(unknowns.inputs)
    return (
        f"no load is known: {names} rests on what process_noise states of {loads}, and its σ does not hold for a load that is "
        "none such; measure one load and state it as known"
    )


def judged_as_stated_in_words(problem: Problem) -> str:
    """That parameters are judged by loads as stated although a load is known, because a damping is sought with them
    (`filter_model`); empty where they are not, or where there is the damping alone."""
    unknowns, damping = problem.unknowns, problem.model.damping.parameter
    others = [name for name in unknowns.parameters if name != damping]
    if not problem.known or not unknowns.inputs or not others or damping not in unknowns.parameters:
        return ""
    return (
        f"{', '.join(others)} is sought together with the damping factor {damping}: its σ rests on what process_noise states of "
        f"{', '.join(unknowns.inputs)}; leave out {damping} to have it judged by what no load could cause"
    )


def scheme_in_words(problem: Problem, h: float) -> str:
    """What the time step of the filter does to the lowest mode; empty where it is exact."""
    if problem.scheme == "exact":
        return ""
    model, at = problem.model, problem.model.reference
    bias = scheme_bias(modal_basis(model, at)[0], model.damping.at(at), h, problem.scheme)
    longer, damped = (values[0] for values in bias)
    return (
        f"the {problem.scheme.replace('_', ' ')} step of {h:g} s lengthens the period of the first mode by "
        f"{100 * longer:.2g} %, so that a modulus comes out {200 * longer:.2g} % off, and adds {100 * damped:.2g} % of damping"
    )


def sample_std(problem: Problem, channels: np.ndarray, h: float, noise_factor: float | np.ndarray = 1.0) -> np.ndarray:
    """σ of one sample every h [s] of channels (k,) or (B, k) [unit of the channel], 1 where there is none."""
    noise_std = problem.channels.noise_std[channels] * np.sqrt(problem.h / h)
    return np.where(channels >= 0, np.asarray(noise_factor)[..., None] * noise_std, 1.0)


def settled_under(problem: Problem, loading: Loading) -> Settled | None:
    """How the motion of a grid filter begins where it is periodic and every load is known; None otherwise."""
    tones = loading.tones
    if tones is None or problem.unknowns.inputs or problem.method != "bank":
        return None
    known = tones.amplitude[:, problem.columns(problem.known)]
    return settled_at(problem, tones.frequency, hold_of_tones(tones.frequency, loading.h)[..., None] * known[:, None])


def settled_at(problem: Problem, frequency: np.ndarray, held: np.ndarray) -> Settled:
    """Periodic up to REST_SHARE; frequency (k,) [rad/s], held (k, HOLD, n_known) complex [N]."""
    return Settled(frequency, held, REST_SHARE * np.abs(problem.x).max(axis=0))


def initial_covariance(problem: Problem, relative_std: Mapping[str, float], moving: bool) -> np.ndarray:
    """P₀ (n*, n*): unknowns as stated, relative to amplitude and guess; every state known to be at rest up to REST_SHARE of
    its largest training amplitude, or moving with all of it."""
    unknowns = problem.unknowns
    std = np.zeros(unknowns.size(problem.model))
    std[: problem.x.shape[1]] = (1.0 if moving else REST_SHARE) * np.abs(problem.x).max(axis=0)
    # The rates that an input's model has beside it may be anything at first: all of them are of order one.
    std[problem.x.shape[1] :] = 1.0
    std[unknowns.position(problem.model)] = [relative_std[name] for name in unknowns.names]
    return np.diag(std**2)


def scenarios_of(
    problem: Problem, channels: np.ndarray, config: PlacementConfig, installation: np.ndarray | None = None
) -> tuple[Scenario, ...]:
    """One fixed linearisation an instant and parameter sample, without a metric yet.

    channels (pool, c): rows of train.h5 of every pool row, −1 for none; installation (m,) [unit² s]: intensity that is added to
    the noise of every channel of train.h5 (`installation_variances`).
    """
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
    # One instant is the thesis's case: any of them, also where a parameter hardly acts.
    count = config.place.instants
    share, u = 0.0 if count == 1 else 0.5, instant_values(problem.u)
    return linearisation_instants(problem.model, problem.unknowns, theta, x, u, count, config.seed, share)


def parameter_samples(
    reference: Mapping[str, float], ranges: Mapping[str, Sequence[float]], count: int, seed: int
) -> list[dict[str, float]]:
    """The guess, then count − 1 points of the box of ranges, evenly by a scrambled Halton sequence; name → value [SI]."""
    names = sorted(reference)
    if count == 1 or not names:
        return [dict(reference)]
    from scipy.stats import qmc  # a quarter of a second to import, which most runs need not spend

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
    """H* (s, pool, c, n*) and r (s, pool, c), or without c where every pool row has one channel, at s instants."""
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
