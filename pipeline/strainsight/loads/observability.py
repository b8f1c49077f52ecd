"""Observability: PBH at λ = 0 (6.1), and directions that no gauge of a set can detect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated

import numpy as np
from scipy.linalg import matrix_balance, qr, schur

from strainsight.columns import Column
from strainsight.errors import ConfigError, NumericalError
from strainsight.fem.affine import NO_CHANGE, AffineOperator
from strainsight.loads.input_models import Unknowns
from strainsight.loads.linearisation import Sensed, linearisation_instants, linearise
from strainsight.mesh.coincident import component_labels
from strainsight.rom.model import ReducedModel, modal_basis
from strainsight.text import listed

MARGINAL = 1e-9
"""Eigenvalues of F* with Re λ ≥ −MARGINAL ‖F*‖ must be detectable by the gauges."""
ROUNDING = 1e-10
"""Gauges respond to a motion if ‖H v‖ > ROUNDING ‖H‖ max|v| in balanced units; less is rounding in v."""
SAME = 1e-7
"""Eigenvalues closer than SAME ‖F*‖ are equal: those of a Jordan block scatter by the root of the rounding."""
RANK = 1e-10
"""A direction is undetectable if the gauges respond to it less than RANK times as much as to its components."""
UNDETECTABLE = 1e-8
"""The same along a run, for readings that are Fourier-transformed and projected orthogonally to the effect of loads."""
MOST_LINES = 200
"""Number of spectral lines used for it, the strongest ones."""


@dataclass(frozen=True)
class Observability:
    """Observability of the unknowns; null_direction: description of the unobservable direction, empty without any."""

    condition: Annotated[
        float,
        Column(
            "1",
            "",
            "condition number of the observability matrix [F − λI; H] at λ = 0 (PBH test); its states are motion, "
            "unknown loads and parameters, scaled with their amplitudes",
        ),
    ]
    sigma_min: Annotated[
        float,
        Column("1", "", "smallest singular value of the scaled observability matrix [F − λI; H] at λ = 0 (PBH test)"),
    ]
    condition_raw: Annotated[
        float,
        Column(
            "1",
            "",
            "condition number of the observability matrix [F − λI; H] at λ = 0 in the scaling of the thesis (Cottone "
            "2022), which depends on the units",
        ),
    ]
    null_direction: str = ""


@dataclass(frozen=True)
class MarginalModes:
    """Eigenvalues λ of F* with Re λ ≥ 0, each once, Im λ ≥ 0, and all its eigenvectors: F* V = λ V.

    eigenvalue [1/s]; vectors: V (n*, g) of each; scale (n*,): balanced units of the states, x* = scale · x̃."""

    eigenvalue: tuple[complex, ...]
    vectors: tuple[np.ndarray, ...]
    scale: np.ndarray


def observability(
    F: np.ndarray,
    H: np.ndarray,
    *,
    names: Sequence[str],
    frequency: np.ndarray,
    state_amplitude: float,
    raw_scale: np.ndarray,
    raw_rows: np.ndarray | None = None,
) -> Observability:
    """Condition number and smallest singular value of the scaled PBH matrix [F* − λI; H*] at λ = 0 (6.1).

        F̃ = D⁻¹ F* D / ω₁,   H̃ = H* D,   D = diag(a/ω, a, 1, 1)

    F (n*, n*) in x* = [q, q̇, ũ, p]; H (m, n*) over the largest reading of the training simulation; names of the unknowns ũ, p;
    frequency ω (n,) [rad/s] of the model coordinates at the reference; state_amplitude a: largest ‖(ωq, q̇)‖ of that run
    [√J]; raw_scale (len(names),): amplitudes and guesses for `condition_raw` as the thesis defines it, in the units of
    [q, q̇, u, θ], so that it depends on units; raw_rows (m, n*): its H*, default H.
    Source: Hautus (1969); thesis (6.1)."""
    n, n_star = len(frequency), len(F)
    D = np.concatenate([state_amplitude / frequency, np.full(n, state_amplitude), np.ones(n_star - 2 * n)])
    scaled = np.vstack([F / D[:, None] * D / frequency.min(), H * D])
    _, sigma, Vt = np.linalg.svd(scaled, full_matrices=False)
    raw = np.concatenate([np.ones(2 * n), raw_scale])
    sigma_raw = np.linalg.svd(np.vstack([F / raw, (H if raw_rows is None else raw_rows) / raw]), compute_uv=False)
    condition = _ratio(sigma)
    direction = direction_in_words(Vt[-1], names) if condition > 1e4 else ""
    return Observability(condition, float(sigma[-1]), _ratio(sigma_raw), direction)


def direction_in_words(direction: np.ndarray, names: Sequence[str]) -> str:
    """Describe `unknowns_in_words`, with the remedy if there are several."""
    words = unknowns_in_words(direction, names)
    return f"{words}: fix or measure one of these unknowns" if words.endswith(TOGETHER) else words


TOGETHER = " together"


def unknowns_in_words(direction: np.ndarray, names: Sequence[str]) -> str:
    """The unknowns (the last states) that a direction (n*,) of x* changes by at least a tenth of the largest change."""
    if not names:
        return "all unknowns"
    part = np.abs(direction[-len(names) :])
    if part.max() <= 1e-6 * np.abs(direction).max():
        return "an undamped motion of the structure"
    involved = [name for name, size in zip(names, part, strict=True) if size >= 0.1 * part.max()]
    if len(involved) == 1:
        return involved[0]
    return listed(involved) + TOGETHER


def marginal_modes(F: np.ndarray) -> MarginalModes:
    """Non-decaying states, Re λ ≥ −1e-9 ‖F‖ in balanced coordinates, which determine detectability.

    F (n, n) [1/s]. The eigenvectors at one λ are combined so that each has a unit entry where the others are zero:
    "one unknown each and the motion it causes". Raises NumericalError if they cannot be separated from decaying states.
    Source: Hautus (1969)."""
    scale = balanced_units(F)
    balanced = F / scale[:, None] * scale
    size = float(np.linalg.norm(balanced))
    T, Z, k = schur(balanced, output="real", sort=lambda real, imag: real >= -MARGINAL * size)
    basis, T = Z[:, :k], T[:k, :k]
    if np.linalg.norm(balanced @ basis - basis @ T) > 1e-8 * size:
        raise NumericalError(
            "the non-decaying states of the model cannot be separated numerically from the decaying states",
            remedy="Check the units of the model and noise levels that differ by many orders of magnitude.",
        )
    eigenvalues: list[complex] = []
    vectors: list[np.ndarray] = []
    for group in _groups(np.linalg.eigvals(T) if k else np.zeros(0), SAME * size):
        mean = complex(group.mean())
        if mean.imag < -SAME * size:
            continue
        # the mean of a cluster is exact even if its members, of a Jordan block, are not
        value = 0.0 if abs(mean) <= SAME * size else mean.real if abs(mean.imag) <= SAME * size else mean
        _, sigma, Yt = np.linalg.svd(T - value * np.eye(k))
        free = sigma <= MARGINAL * size
        free[-1] = True
        V = basis @ Yt[free].conj().T
        pivots = qr(V.conj().T, mode="r", pivoting=True)[1][: V.shape[1]]
        eigenvalues.append(complex(value))
        vectors.append(scale[:, None] * (V @ np.linalg.inv(V[pivots])) / scale[pivots])
    return MarginalModes(tuple(eigenvalues), tuple(vectors), scale)


def balanced_units(F: np.ndarray) -> np.ndarray:
    """Units (n,) of the states in which rows and columns of F (n, n) have similar norms: x = units · x̃.

    A state whose row or column is zero, such as that of a random walk, is excluded from LAPACK's balancing, where its units would
    change those of the others; its other one is scaled to the mean norm of the rest."""
    outside = np.abs(F - np.diag(np.diag(F)))
    rows, columns = outside.any(axis=1), outside.any(axis=0)
    whole, scale = rows & columns, np.ones(len(F))
    if not whole.any():
        return scale
    balanced, (scale[whole], _) = matrix_balance(F[np.ix_(whole, whole)], permute=False, separate=True)
    inner = np.abs(balanced - np.diag(np.diag(balanced)))
    typical = float(np.sqrt(np.mean(np.linalg.norm(inner, axis=1) * np.linalg.norm(inner, axis=0)))) or 1.0
    driver, follower = columns & ~rows, rows & ~columns
    answer = np.linalg.norm(outside[:, driver][whole] / scale[whole, None], axis=0)
    scale[driver] = np.divide(typical, answer, out=np.ones(len(answer)), where=answer > 0)
    cause = np.linalg.norm(outside[follower][:, whole] * scale[whole], axis=1)
    scale[follower] = np.where(cause > 0, cause / typical, 1.0)
    return scale


def undetectable_directions(F: np.ndarray, H: np.ndarray, modes: MarginalModes | None = None) -> np.ndarray:
    """Basis (n, k) of the motions that neither decay nor cause a reading; k = 0 if (F, H) is detectable.

        F v = λ v,   Re λ ≥ 0,   H v = 0:   v = V · null(H V), columns of H V at unit norm; Re v, Im v of a complex v

    F (n, n) [1/s]; H (m, n), rows of any scaling; modes: those of F, if already known. The rank is that of an SVD with the
    tolerance 1e-10, independent of the units of states and gauges. Source: Hautus (1969)."""
    modes = marginal_modes(F) if modes is None else modes
    directions = [np.zeros((len(F), 0))]
    strength = np.linalg.norm(H * modes.scale)
    for value, V in zip(modes.eigenvalue, modes.vectors, strict=True):
        O = H @ V
        length = np.linalg.norm(O, axis=0)
        answers = length > ROUNDING * strength * (np.abs(V) / modes.scale[:, None]).max(axis=0)
        per_length = np.divide(1.0, length, out=np.zeros(len(length)), where=answers)
        R = np.linalg.qr(O * per_length, mode="r")  # as many rows as eigenvectors, however many gauges
        _, sigma, Yt = np.linalg.svd(R, full_matrices=True)
        sigma = np.concatenate([sigma, np.zeros(V.shape[1] - len(sigma))])
        null = Yt[sigma <= RANK * max(1.0, sigma[0])].conj().T
        v = V @ (np.where(answers, per_length, 1.0)[:, None] * null)
        directions += [v.real, v.imag] if value.imag else [v.real]
    return np.hstack(directions)


def unseen_along(
    F: np.ndarray, B: np.ndarray, H: np.ndarray, D: np.ndarray, driven: np.ndarray, read: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """Directions of the parameters that no reading along a run reveals, because unknown loads compensate them.

        y(ω) = H (iω − F)⁻¹ f(ω) + r(ω),     loads affect the span of H (iω − F)⁻¹ B + D

    At one instant a parameter acts like a constant load, which accelerometers do not measure; along the run it acts at the
    frequencies of the motion. y is projected orthogonally to the effect of loads, line by line; a direction is undetectable if
    less than UNDETECTABLE of its components remains. Returns RMS loads (u, d) that compensate, and parameters (k, d); d = 0 if
    all parameters are detectable.
    F (n, n) [1/s]; B (n, u) and D (m, u) for RMS loads; H (m, n).
    driven f (s, n, k) and read r (s, m, k): columns of F* and H* of the parameters, at s instants h [s] apart."""
    f, r = np.fft.rfft(driven, axis=0), np.fft.rfft(read, axis=0)
    omega, k = 2 * np.pi * np.fft.rfftfreq(len(driven), h), driven.shape[-1]
    scale = balanced_units(F)
    size = np.linalg.norm(f / scale[:, None], axis=(1, 2)) + np.linalg.norm(r, axis=(1, 2))
    whole, across, compensation = np.zeros(k), [np.zeros((k, k))], [np.zeros((B.shape[1], k))]
    for i in np.argsort(-size, kind="stable")[:MOST_LINES]:
        lhs = (1j * omega[i] * np.eye(len(F)) - F) / scale[:, None] * scale
        if not omega[i] and np.linalg.cond(lhs) > 1 / RANK:
            continue  # a free structure has no static response
        answer = np.linalg.solve(lhs, np.hstack([f[i], B]) / scale[:, None])
        y, by_loads = np.split(H * scale @ answer + np.hstack([r[i], D]), [k], axis=1)
        compensation.append(np.linalg.pinv(by_loads, rcond=RANK) @ y)
        remainder = y - by_loads @ compensation[-1]
        across += [remainder.real, remainder.imag]
        whole += np.sum((np.abs(H * scale) @ np.abs(answer[:, :k]) + np.abs(r[i])) ** 2, axis=0)
    per_length = np.divide(1.0, np.sqrt(whole), out=np.ones(k), where=whole > 0)
    _, sigma, Yt = np.linalg.svd(np.vstack(across) * per_length, full_matrices=False)
    parameters = per_length[:, None] * Yt[sigma <= UNDETECTABLE].T
    parameters /= np.abs(parameters).max(axis=0, initial=1e-300)
    return np.linalg.norm(np.array(compensation) @ parameters, axis=0) / len(driven), parameters


def least_gauges(modes: MarginalModes) -> int:
    """Least number of gauges that can detect all non-decaying states: the largest number of eigenvectors at one eigenvalue."""
    return max((V.shape[1] for V in modes.vectors), default=0)


def undetectable_in_words(directions: np.ndarray, names: Sequence[str]) -> str:
    """The undetectable directions (n*, k) by the names of the unknowns that they change."""
    return "; ".join(direction_in_words(column, names) for column in directions.T)


def _groups(values: np.ndarray, distance: float) -> list[np.ndarray]:
    """Clusters of the values, the last one first: a value within `distance` of a member belongs to it."""
    label = component_labels(len(values), *np.nonzero(np.abs(values[:, None] - values) <= distance))
    return [values[label == group] for group in dict.fromkeys(label[::-1].tolist())]


def _ratio(sigma: np.ndarray) -> float:
    return float(sigma[0] / sigma[-1]) if sigma[-1] > 0 else float("inf")


GROUPS = 4
ORDER = tuple(chosen for count in range(1, GROUPS + 1) for chosen in combinations(range(GROUPS), count))
"""Groups of unknowns (inputs, moduli, densities, damping) that are combined; the first three in the order of the tables."""


@dataclass(frozen=True)
class Case:
    """PBH at λ = 0 of one set of unknowns, at the instant with the median of its scaled condition.

    label: "input+E+rho"; unknowns: their names; result: condition, σ_min, raw condition of the thesis and the null direction, all
    at that instant; instant: its index in the motion, −1 without any; instants: number of instants of the median; reason: why it
    is unobservable without a computation, else empty.

    """

    label: str
    unknowns: tuple[str, ...]
    result: Observability
    instant: int
    instants: int
    reason: str = ""


def cases(
    model: ReducedModel,
    theta: Mapping[str, float],
    x: np.ndarray,
    u: np.ndarray,
    *,
    inputs: Sequence[str],
    moduli: Sequence[str],
    densities: Sequence[str],
    damping: Sequence[str] = (),
    amplitude: Mapping[str, float],
    guess: Mapping[str, float],
    sensed: Sensed,
    largest: np.ndarray,
    instants: int,
    seed: int,
) -> tuple[Case, ...]:
    """Every combination of unknown inputs, moduli, densities and damping at the same motion; fewer if a group is empty.

    Each is linearised at its `linearisation_instants`; the instant of the median condition represents it, for an even number the
    better of the two middle ones. Inputs are random walks, whatever their model in the filter.

    theta: all parameters [SI]; x (s, 2n) = [q, q̇], u (s, n_u) [N]: the motion; inputs, moduli, densities, damping: names;
    amplitude [N], guess [SI]: scales of the unknowns; sensed: every channel (m,); largest (m,): largest reading of the
    quantity of the channel in that motion, by which its row is divided. A parameter that never affects the motion makes its
    cases unobservable, with that as the reason.
    Raises ConfigError if a quantity has no reading in the motion. Source: thesis (6.1), tables 6.1 and 6.2."""
    groups = (("input", tuple(inputs)), ("E", tuple(moduli)), ("rho", tuple(densities)), ("damping", tuple(damping)))
    if not np.all(largest > 0):
        raise ConfigError(
            f"{np.sum(~(largest > 0))} of {len(largest)} channels have zero readings in the training simulation (stage `train`)",
            remedy="Apply a load that these channels measure, or remove their sensors.",
        )
    lam = modal_basis(model, model.reference)[0]
    n = model.size
    energy = float(np.sqrt(np.sum(lam * x[:, :n] ** 2 + x[:, n:] ** 2, axis=1)).max())
    scaled, unscaled = _compress(sensed, 1 / np.asarray(largest)), _compress(sensed, np.ones(len(largest)))
    results_by_case = []
    for chosen in ORDER:
        if any(not groups[g][1] for g in chosen):
            continue
        label = "+".join(groups[g][0] for g in chosen)
        parameters = tuple(name for g in chosen if g > 0 for name in groups[g][1])
        unknowns = Unknowns(groups[0][1] if 0 in chosen else (), parameters, amplitude, guess)
        try:
            at = linearisation_instants(model, unknowns, theta, x, u, instants, seed)
        except ConfigError as error:
            nothing = Observability(float("inf"), 0.0, float("inf"))
            results_by_case.append(Case(label, unknowns.names, nothing, -1, 0, error.what))
            continue
        motion = model, unknowns, theta, x[at], u[at]
        F = linearise(*motion)
        scaled_rows, unscaled_rows = (rows.linearised(*motion, F) for rows in (scaled, unscaled))
        results = [
            observability(
                each,
                divided,
                names=unknowns.names,
                frequency=np.sqrt(lam),
                state_amplitude=energy,
                raw_scale=unknowns.scale,
                raw_rows=raw,
            )
            for each, divided, raw in zip(F, scaled_rows, unscaled_rows, strict=True)
        ]
        middle = np.argsort([result.condition for result in results], kind="stable")[(len(at) - 1) // 2]
        results_by_case.append(Case(label, unknowns.names, results[middle], int(at[middle]), len(at)))
    return tuple(results_by_case)


def _compress(sensed: Sensed, factor: np.ndarray) -> Sensed:
    """Few rows for each quantity with the same HᵀH at any θ, and so the same singular values, for any number of channels; factor
    (m,) of each of its rows."""
    n, labels = sensed.rows.shape[1], list(sensed.change.terms)
    both = factor[:, None] * np.hstack([sensed.rows, *(sensed.change.terms[label] for label in labels)])
    parts = [(kind, np.linalg.qr(both[sensed.quantity == kind], mode="r")) for kind in np.unique(sensed.quantity)]
    R = np.vstack([R for _, R in parts])
    terms = {label: R[:, k * n : (k + 1) * n] for k, label in enumerate(labels, start=1)}
    change = AffineOperator(NO_CHANGE.constant, terms, sensed.change.coefficients)
    return Sensed(R[:, :n], np.concatenate([np.full(len(R), kind) for kind, R in parts]), change)
