"""Reduced model at given parameters: linear, for parallel filters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.estimation.model import FilterModel
from strainsight.estimation.parallel_filters import LinearModels, ModalMotion, pad_zeros
from strainsight.rom.modal_step import HOLD, ModalMap, acceleration_map, modal_step, scheme_step
from strainsight.rom.model import first_of_equal, modal_basis

MASS = "mass"
"""Source of variance: masses that the model lacks."""
DIFFERENCE = 1e-3
"""Step of the differences of accelerometer rows in frequencies, and of the start in parameters."""


@dataclass(frozen=True)
class ConsideredParameters:
    """Considered constants ν (Schmidt-Kalman) of mean zero and variance one, in addition to states and parameters.

    With the filter states x (n,) = [q, q̇, ζ], the loads w₁ known at the instant and all loads u:

        y = h(x) + Σₖ νₖ(Dₖx + Eₖw₁ + oₖ + Σⱼ νⱼBₖⱼuⱼ)

    source (d,): meaning of each ν of the readings; D (d, m, n), E (d, m, n_known), o (d, m); with drifts E (d, m, n_known +
    1), where t/T follows the loads in w₁ (`known_ends`). Those of the motion come first. damping: σ of ln c of each mode;
    frequency (k, r): change of ln ω of each mode per unit ν, the last `masses` of them by mass errors; stiffness: σ of the
    logarithm of one common scale; 0 if exact.
    shape (f, r, n_u): change of the input shape S [1/√kg] of r coordinates by the first f of the others; its instantaneous
    effect is in D and E (`load_rows`). load (f,): the input u [N] that each of them changes; load_std (f,): σ of its error
    [rad or m]. Truncated displacements are proportional to νⱼuⱼ; behind: whether a smoother appends them to its states; B (d,
    m, f): their effect on the readings per unit ν. learned: whether the samples' estimate of ν corrects motion and loads, which
    reduces σ; otherwise gains of unknown loads consider ν (`considers`). For parameters ν is always integrated out.
    discrepancy: σ of white model error over the RMS of a reading, relevant for parameters under known loads. about (d,), or of
    the first ν, others zero: linearisation point of the readings (`linearise_about_samples`). centre (k,): parameters whose
    natural frequencies are used at all
    others (`tune_frequencies`); None: no common frequencies. inertia (p, n + n_known): σ of the mass at each of p unknown loads
    times its acceleration, in unit amplitudes of the load, per state and known load (`inertia_std`); empty without. lacking (r,
    r): one σ of these masses in the mass matrix, for parameters that known loads determine (`filter_records`); empty without."""

    source: tuple[str, ...]
    D: np.ndarray
    E: np.ndarray
    offset: np.ndarray
    damping: float = 0.0
    stiffness: float = 0.0
    learned: bool = False
    discrepancy: float = 0.0
    shape: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 0)))
    load: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    load_std: np.ndarray = field(default_factory=lambda: np.zeros(0))
    behind: bool = False
    B: np.ndarray | None = None
    about: np.ndarray = field(default_factory=lambda: np.zeros(0))
    frequency: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    masses: int = 0
    centre: np.ndarray | None = None
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    lacking: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def sources(self, modes: int) -> tuple[str, ...]:
        """Meaning of each ν, those of the motion first."""
        of_modes = ("damping",) * (modes * (self.damping > 0)) + ("frequency",) * (len(self.frequency) - self.masses)
        of_modes += (MASS,) * self.masses
        return of_modes + ("stiffness",) * (self.stiffness > 0) + self.source

    def of_modes(self, modes: int) -> int:
        """Number of ν for damping and frequency of modes; they come first."""
        return modes * (self.damping > 0) + len(self.frequency)


def none_considered(model: FilterModel) -> ConsideredParameters:
    """No considered parameters."""
    m = model.H.shape[-2]
    return ConsideredParameters(
        (), np.zeros((0, m, model.parameter_states.start)), np.zeros((0, m, len(model.known_inputs))), np.zeros((0, m))
    )


def split_by_record(
    considered: ConsideredParameters, count: int, renewed: tuple[str, ...]
) -> tuple[ConsideredParameters, ...]:
    """Considered parameters of `count` successive records: ν of the sources `renewed` belong to one record, all others to
    all. Renewed ν follow the others, one set per record, without effect in other records. They affect readings only."""
    if count == 1:
        return (considered,)
    renews = np.array([source in renewed for source in considered.source], dtype=bool)
    shared, own_of = np.flatnonzero(~renews), np.flatnonzero(renews)
    order = np.concatenate([shared, *[own_of] * count])

    def of_record(record: int) -> ConsideredParameters:
        inactive = len(shared) + np.flatnonzero(np.repeat(np.arange(count) != record, len(own_of)))

        def stacked(rows: np.ndarray) -> np.ndarray:
            rows = rows[order]
            rows[inactive] = 0.0
            return rows

        D, E, offset = (stacked(rows) for rows in (considered.D, considered.E, considered.offset))
        B, source = None if considered.B is None else stacked(considered.B), tuple(considered.source[i] for i in order)
        return replace(considered, source=source, D=D, E=E, offset=offset, B=B)

    return tuple(of_record(record) for record in range(count))


def known_ends(known: np.ndarray, considered: ConsideredParameters) -> np.ndarray:
    """w₁ (T, p₁) at the end of each step: known loads [N], and the share t/T of the record with drifts; known (T, HOLD,
    n_known)."""
    loads, steps = np.asarray(known.sum(axis=1)), len(known)
    if considered.E.shape[-1] == loads.shape[1]:
        return loads
    return np.column_stack([loads, np.arange(1, steps + 1) / steps])


def inertia_std(
    model: FilterModel, considered: ConsideredParameters, mean: np.ndarray, loads: np.ndarray
) -> np.ndarray:
    """σ (T, n*) of x* by masses that the model lacks at unknown loads: σ_m |a|, a the acceleration of the point of the load.

    Measurements cannot separate such a load f from the inertia of the mass: the filter estimates f − m a. mean (T, n*) of x*;
    loads (T, n_known): known loads at the same instants."""
    std = np.zeros_like(mean)
    if considered.inertia.any():
        rows, n = considered.inertia, model.parameter_states.start
        of_loads = mean[:, :n] @ rows[:, :n].T + loads[:, : rows.shape[1] - n] @ rows[:, n:].T
        std[:, model.position[: len(rows)]] = np.abs(of_loads)
    return std


def conditional_states(model: FilterModel, offsets: int = 0) -> np.ndarray:
    """Indices in x* of the filter states [q, q̇, ζ] and of the channel offsets behind it."""
    return np.concatenate([np.arange(model.parameter_states.start), np.arange(model.size, model.size + offsets)])


def considers(model: FilterModel, considered: ConsideredParameters) -> bool:
    """Whether the gains for motion and loads consider ν: with unknown loads, which follow the samples, and ν that is not
    learned."""
    return bool(model.unknowns.inputs and considered.sources(model.model.size)) and not considered.learned


def discrepancy(model: FilterModel, considered: ConsideredParameters, measurement: np.ndarray) -> np.ndarray:
    """Variance (m,) of the discrepancy of samples (T, m), NaN if missing; zero with unknown loads, which follow the samples, or
    without parameters."""
    if model.unknowns.inputs or not model.unknowns.parameters:
        return np.zeros(measurement.shape[1])
    count = np.maximum(np.isfinite(measurement).sum(axis=0), 1)
    return considered.discrepancy**2 * np.nansum(measurement**2, axis=0) / count


def linear_models(
    model: FilterModel, point: np.ndarray, considered: ConsideredParameters, biased: np.ndarray | None = None
) -> LinearModels:
    """The filter model without its parameters, at B values p (B, k); noise as in the model at the guess. biased (b,):
    channels with an offset, b more states behind [q, q̇, ζ]."""
    theta, B, process = theta_at(model, point), len(point), model.process
    model, shift = tune_frequencies(apply_damping(model, considered), considered, point)
    states, m = model.parameter_states.start, model.H.shape[-2]
    modal = _add_batch_axis(modal_step(model.model, theta, model.h, model.scheme), B)
    read = model.rows_at(theta)
    H, F = np.array(np.broadcast_to(read[..., :states], (B, m, states))), np.zeros((B, m, len(model.known_inputs)))
    if model.accelerometers is not None:
        moving = model.accelerometers
        H[:, moving], F[:, moving] = acceleration_rows(model, theta, read[..., moving, : model.model.size])
    motion = _motion(model, modal, considered, theta)
    e = motion.pairs_nu.shape[1]
    f = len(considered.load) if considered.B is not None and considered.B.any() else 0
    truncation = np.zeros((len(considered.D), m, 0)) if considered.B is None or f == 0 else considered.B
    rows, fed = load_rows(model, np.eye(len(model.model.inputs))[considered.load[:f]])
    D, E, offset, B_nu = (
        np.concatenate([np.zeros((e - len(considered.shape), *array.shape[1:])), array])
        for array in (considered.D, considered.E, considered.offset, truncation)
    )
    of_modes, drifts = considered.of_modes(model.model.size), considered.E.shape[-1] - F.shape[-1]
    frequencies = slice(of_modes - len(considered.frequency), of_modes)
    if model.accelerometers is not None and len(considered.frequency):
        on_states, on_known = _accelerations_by_frequency(model, considered, point)
        D[frequencies, moving], E[frequencies, moving, : F.shape[-1]] = on_states, on_known
    about, shifts = np.pad(considered.about, (0, len(D) - len(considered.about))), np.zeros((B, len(D)))
    fixed_slope = about != 0
    shifts[:, frequencies] = shift
    fixed_slope[frequencies] = True
    models = LinearModels(
        motion,
        np.broadcast_to(process[:states, :states], (B, states, states)),
        H,
        pad_zeros(F, drifts, -1),
        D=D,
        E=E,
        offset=offset,
        B=B_nu,
        U=rows,
        W=pad_zeros(fed, drifts, -1),
        about=about,
        shift=shifts,
        fixed_slope=fixed_slope,
    )
    models = _linearise_about(models, of_modes)
    return models if biased is None or not len(biased) else _add_offsets(models, biased)


def _linearise_about(models: LinearModels, of_modes: int) -> LinearModels:
    """Linearise about ν = a; the first ν, of damping and frequency, are part of the models already: A + Σₖ aₖAₖ,   H + Σₖ
    aₖ(Dₖ + Σⱼ aⱼBₖⱼUⱼ),   ∂H/∂νₖ = Dₖ + Σⱼ aⱼBₖⱼUⱼ, of a load j + Σₖ aₖBₖⱼUⱼ"""
    e, f = models.moving, len(models.U)
    a = np.where(np.arange(len(models.about)) < of_modes, 0.0, models.about)
    if not a.any():
        return models
    loads = slice(e - f, e)
    truncation, turned = models.B * a[loads], np.einsum("k,kmj->jm", a, models.B)[..., None]
    D, E = models.D + truncation @ models.U, models.E + truncation @ models.W
    H, F = models.H + np.einsum("k,kmn->mn", a, D), models.F + np.einsum("k,kmp->mp", a, E)
    D[loads] += turned * models.U[:, None]
    E[loads] += turned * models.W[:, None]
    return replace(models, motion=models.motion.about(a[:e]), H=H, F=F, D=D, E=E)


def _add_offsets(models: LinearModels, biased: np.ndarray) -> LinearModels:
    """Add a constant state for each biased channel (b,)."""
    b = len(biased)
    H, D, U = (pad_zeros(each, b, -1) for each in (models.H, models.D, models.U))
    H[:, biased, range(-b, 0)] = 1.0
    return replace(models, motion=models.motion.with_constants(b), H=H, Q=pad_zeros(models.Q, b, -1, -2), D=D, U=U)


def apply_damping(model: FilterModel, considered: ConsideredParameters) -> FilterModel:
    """The model with the damping of the linearisation point, c exp(σν) of each mode."""
    if considered.damping == 0 or not considered.about.any():
        return model
    damping = model.model.damping
    factors = np.exp(considered.damping * considered.about[: model.model.size]) * (
        np.array(damping.factors) if damping.factors else 1.0
    )
    return replace(model, model=replace(model.model, damping=damping.scaled(factors.tolist())))


def tune_frequencies(
    model: FilterModel, considered: ConsideredParameters, point: np.ndarray
) -> tuple[FilterModel, np.ndarray]:
    """The model with the natural frequencies of the linearisation point at B parameter values p (B, k), and the shift (B, k′) of
    ν from `about`.

    Readings determine a resonance frequency much better than a parameter and ν that both change it. Therefore all p use the
    frequencies of the centre, for all modes with a frequency tolerance, by the least ν:

        ωⱼ(p) exp(Σₖ Fₖⱼ aₖ(p)) = ωⱼ(p̄)

    Slopes at ν = 0 are valid only for a fraction of the width of a resonance."""
    frequency = considered.frequency
    shift, about = (
        np.zeros((len(point), len(frequency))),
        np.pad(considered.about, (0, model.model.size + len(frequency))),
    )
    about = about[considered.of_modes(model.model.size) - len(frequency) :][: len(frequency)]
    if not frequency.any() or (considered.centre is None and not about.any()):
        return model, shift
    lam, _ = modal_basis(model.model, theta_at(model, point))
    lam = np.broadcast_to(lam, (len(point), model.model.size))
    if considered.centre is not None:
        of_centre, _ = modal_basis(model.model, theta_at(model, considered.centre[None]))
        felt = (frequency != 0).sum(axis=0) == (frequency != 0).sum(axis=0).max()
        shift = 0.5 * np.log(of_centre / lam)[:, felt] @ np.linalg.pinv(frequency[:, felt])
    factors = np.exp(np.einsum("bk,kbj->bj", shift + about, frequency[:, first_of_equal(lam)]))
    return replace(model, model=replace(model.model, frequency_factors=factors)), shift


def _accelerations_by_frequency(
    model: FilterModel, considered: ConsideredParameters, point: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivity of accelerometers to each frequency ν: rows (k, m′, states), and (k, m′, n_known) on known loads; at the
    centre, or the first of the points (B, k)."""
    moving, here = model.accelerometers, point[:1] if considered.centre is None else considered.centre[None]
    theta = theta_at(model, here)
    model, _ = tune_frequencies(replace(model, model=replace(model.model, frequency_factors=None)), considered, here)
    factors = np.ones((1, model.model.size)) if model.model.frequency_factors is None else model.model.frequency_factors
    first = first_of_equal(modal_basis(model.model, theta)[0])
    shape = np.broadcast_to(model.rows_at(theta), (1, *model.H.shape))[:, moving, : model.model.size]

    def read(nu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        changed = replace(model.model, frequency_factors=factors * np.exp(nu))
        on_states, on_known = acceleration_rows(replace(model, model=changed), theta, shape)
        return on_states[0], on_known[0]

    slopes = []
    for each in considered.frequency:
        ends = [read(step * each[first]) for step in (DIFFERENCE, -DIFFERENCE)]
        slopes.append([(ahead - behind) / (2 * DIFFERENCE) for ahead, behind in zip(*ends, strict=True)])
    on_states, on_known = (np.array(parts) for parts in zip(*slopes, strict=True))
    return on_states, on_known


def theta_at(model: FilterModel, point: np.ndarray) -> dict[str, np.ndarray]:
    """All parameters [SI], each (B,), at the values p (B, k) of the estimated ones."""
    names, guess = model.unknowns.parameters, model.unknowns.guess
    fixed = {name: np.full(len(point), value) for name, value in model.fixed.items()}
    return fixed | {name: guess[name] * np.exp(point[:, i]) for i, name in enumerate(names)}


def acceleration_rows(
    model: FilterModel, theta: Mapping[str, np.ndarray], shape: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rows of accelerometers of shape φ (k, n) or (B, k, n): (B, k, states) on [q, q̇, ζ], and (B, k, n_known) on known loads."""
    sensed = _add_batch_axis(acceleration_map(model.model, theta))
    rows, on_known = load_rows(model, shape @ sensed.input[..., 0, :])
    rows[..., model.motion] = shape @ sensed.transition
    return rows, on_known


def load_rows(model: FilterModel, direct: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of a direct effect of all loads `direct` (..., k, n_u): (..., k, states) on [q, q̇, ζ], and (..., k, n_known)."""
    unknown, known = model.columns
    rows = np.zeros((*direct.shape[:-1], model.parameter_states.start))
    rows[..., model.position[: len(unknown)]] = direct[..., unknown] * model.amplitude
    return rows, direct[..., known]


def acceleration_change(model: FilterModel, theta: Mapping[str, np.ndarray], change: np.ndarray) -> np.ndarray:
    """M⁻¹ΔS (B, n, n_u): instantaneous change of q̈ by a change ΔS (n, n_u) of the input shape."""
    return _add_batch_axis(acceleration_map(model.model.acted_on(change), theta)).input[..., 0, :]


def _add_batch_axis(modal: ModalMap, count: int = 1) -> ModalMap:
    """Add an axis of parameter values; a model without parameters is repeated `count` times."""
    if modal.transition.ndim > 2:
        return modal
    parts = (modal.transition, modal.input, modal.shape, modal.eigenvalue, modal.modes, modal.dual)
    tables = (np.repeat(each[:, :, None], count, axis=2) for each in (modal.table, modal.table_slope))
    return ModalMap(*(np.repeat(each[None], count, axis=0) for each in parts), *(*tables, modal.table_damped))


def _motion(
    model: FilterModel, modal: ModalMap, considered: ConsideredParameters, theta: Mapping[str, np.ndarray]
) -> ModalMotion:
    """A step in modal coordinates, and σ times its derivatives in ln c, frequencies, ln stiffness and input shape. Each mode
    of a step depends on its λ and c only: damping of mode j affects its row, and those of the same frequency."""
    damping, q, lam = model.model.damping.at(theta), model.model.size, modal.eigenvalue
    unknown, known = model.columns
    B, n, hold, moving = len(lam), model.parameter_states.start, HOLD, 2 * q
    zeta = model.hold.reshape(hold * len(unknown), n - moving)
    Phi_T = np.swapaxes(modal.modes, 1, 2)

    def step(table: np.ndarray, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """pairs (B, 4, q), augmented (B, s, n) and fed (B, n, p), from a table (2, 2 + HOLD, B, q) and modal forces (B, q,
        n_u)."""
        pairs = np.moveaxis(table[:, :2].reshape(4, B, q), 0, 1)
        # (B, 2q, HOLD, n_u)
        pushed = (table[:, 2:, ..., None] * forces).transpose(2, 0, 3, 1, 4).reshape(B, moving, hold, -1)
        augmented, fed = np.zeros((B, n - moving, n)), np.zeros((B, n, hold * len(known)))
        on_zeta = pushed[..., unknown].reshape(B, moving, hold * len(unknown)) @ zeta
        augmented[:, :, :moving] = np.swapaxes(on_zeta, 1, 2)
        fed[:, :moving] = pushed[..., known].reshape(B, moving, hold * len(known))
        return pairs, augmented, fed

    forces = Phi_T @ modal.shape
    pairs, augmented, fed = step(modal.table, forces)
    augmented[:, :, moving:] = model.transition.T
    slopes: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    if considered.damping > 0:
        _, by_damping = scheme_step(lam, damping, model.h, model.scheme, "damping")
        same = first_of_equal(lam)
        slopes += [step(considered.damping * by_damping * (same == j), forces) for j in range(q)]
    by_stiffness = lam * modal.table_slope
    if len(considered.frequency):
        # λ → λ(1 + s)² and forces → (1 + s)² times them, damped as at that λ
        by_frequency = 2 * by_stiffness
        by_frequency[:, 2:] += 2 * modal.table[:, 2:]
        slopes += [step(by_frequency * each[first_of_equal(lam)], forces) for each in considered.frequency]
    if considered.stiffness > 0:  # λ → λ(1 + s) of every mode, damped as at that λ
        table = considered.stiffness * by_stiffness
        slopes.append(step(table, forces))
    for change in considered.shape:
        _, pushed, loaded = step(modal.table, Phi_T @ change)
        slopes.append((0 * pairs, pushed, loaded))
    basis, inverse = np.tile(np.eye(n), (2, B, 1, 1))
    for own_states in (slice(0, q), slice(q, moving)):
        basis[:, own_states, own_states], inverse[:, own_states, own_states] = modal.modes, modal.dual
    none = [(pairs[:, None][:, :0], augmented[:, None][:, :0], fed[:, None][:, :0])]
    by_nu = [np.stack(each, axis=1) for each in zip(*slopes, strict=True)] if slopes else none[0]
    return ModalMotion(basis, inverse, pairs, augmented, fed, *by_nu)
