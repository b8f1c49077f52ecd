"""What the gauges can tell at all: PBH at λ = 0 (6.1), and the directions no gauge of a set can detect."""

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
from strainsight.mesh.unjoined import component_labels
from strainsight.rom.model import ReducedModel, modal_basis

MARGINAL = 1e-9
"""An eigenvalue of F* with Re λ ≥ −MARGINAL ‖F*‖ has to be detected by the gauges."""
ROUNDING = 1e-10
"""Gauges answer to a motion where ‖H v‖ > ROUNDING ‖H‖ max|v| in balanced units: less is rounding in v."""
SAME = 1e-7
"""Eigenvalues closer than SAME ‖F*‖ are one: those of a Jordan block scatter by the root of the rounding."""
RANK = 1e-10
"""A direction is undetectable where the gauges answer to it less than RANK times as much as to its parts."""
UNSEEN = 1e-8
"""The same along a run, of readings that were transformed and projected across what loads read;"""
MOST_LINES = 200
"""and the lines of its spectrum in which this is looked at, the strongest."""


@dataclass(frozen=True)
class Observability:
    """Observability of the unknowns; null_direction: what is not, in words, empty where every direction is."""

    condition: Annotated[float, Column("1", "", "condition of the scaled PBH matrix at λ = 0")]
    sigma_min: Annotated[float, Column("1", "", "its smallest singular value")]
    condition_raw: Annotated[
        float, Column("1", "", "the same without scales, as the thesis prints it, which orders cases by their units")
    ]
    null_direction: str = ""


@dataclass(frozen=True)
class MarginalModes:
    """Eigenvalues λ of F* with Re λ ≥ 0, each once, Im λ ≥ 0, and all its eigenvectors: F* V = λ V.

    eigenvalue [1/s]; vectors: V (n*, g) of each; scale (n*,): balanced units of the states, x* = scale · x̃.
    """

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

    F (n*, n*) in x* = [q, q̇, ũ, p]; H (m, n*) rows over the largest reading of the training run; names of the unknowns ũ, p;
    frequency ω (n,) [rad/s] of the model's coordinates at the reference; state_amplitude a: largest ‖(ωq, q̇)‖ of that run
    [√J]; raw_scale (len(names),): amplitudes and guesses, which give `condition_raw` as the thesis defines it, in the units
    of [q, q̇, u, θ]: it orders cases by their units; raw_rows (m, n*): H* of that number, H itself where not given.
    Source: Hautus (1969); thesis (6.1).
    """
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
    """The unknowns (the last states) that a direction (n*,) of x* changes by a tenth of the most or more."""
    if not names:
        return "all that is asked for"
    part = np.abs(direction[-len(names) :])
    if part.max() <= 1e-6 * np.abs(direction).max():
        return "an undamped motion of the structure itself"
    involved = [name for name, size in zip(names, part, strict=True) if size >= 0.1 * part.max()]
    if len(involved) == 1:
        return involved[0]
    return f"{', '.join(involved[:-1])} and {involved[-1]} together: fix one of them, or make one known"


def marginal_modes(F: np.ndarray) -> MarginalModes:
    """What does not decay by itself, Re λ ≥ −1e-9 ‖F‖ in balanced coordinates: what detectability depends on.

    F (n, n) [1/s]. The eigenvectors at one λ are combined so that each has a unit entry where the others have none:
    "one unknown each and the motion it causes". Raises NumericalError where they cannot be separated from what decays.
    Source: Hautus (1969).
    """
    scale = balanced_units(F)
    balanced = F / scale[:, None] * scale
    size = float(np.linalg.norm(balanced))
    T, Z, k = schur(balanced, output="real", sort=lambda real, imag: real >= -MARGINAL * size)
    basis, T = Z[:, :k], T[:k, :k]
    if np.linalg.norm(balanced @ basis - basis @ T) > 1e-8 * size:
        raise NumericalError("the states that do not decay cannot be separated from those that do")
    found: list[complex] = []
    vectors: list[np.ndarray] = []
    for group in _groups(np.linalg.eigvals(T) if k else np.zeros(0), SAME * size):
        mean = complex(group.mean())
        if mean.imag < -SAME * size:
            continue
        # the mean of a cluster is exact where its members, of a Jordan block, are not
        value = 0.0 if abs(mean) <= SAME * size else mean.real if abs(mean.imag) <= SAME * size else mean
        _, sigma, Yt = np.linalg.svd(T - value * np.eye(k))
        free = sigma <= MARGINAL * size
        free[-1] = True
        V = basis @ Yt[free].conj().T
        pivots = qr(V.conj().T, mode="r", pivoting=True)[1][: V.shape[1]]
        found.append(complex(value))
        vectors.append(scale[:, None] * (V @ np.linalg.inv(V[pivots])) / scale[pivots])
    return MarginalModes(tuple(found), tuple(vectors), scale)


def balanced_units(F: np.ndarray) -> np.ndarray:
    """Units (n,) of the states in which rows and columns of F (n, n) have like norms: x = units · x̃.

    A state whose row or column is zero, as that of a random walk, is left out of LAPACK's balance, where its units would
    change those of the others; its other one is brought to the mean norm of the rest.
    """
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
    """Basis (n, k) of the motions that neither decay nor show in any gauge; k = 0 where (F, H) is detectable.

        F v = λ v,   Re λ ≥ 0,   H v = 0:   v = V · null(H V), columns of H V at unit norm; Re v, Im v of a complex v

    F (n, n) [1/s]; H (m, n), rows of any scaling; modes: those of F, where already known. The rank is that of an SVD
    with the tolerance 1e-10, independent of the units of states and gauges. Source: Hautus (1969).
    """
    modes = marginal_modes(F) if modes is None else modes
    lost = [np.zeros((len(F), 0))]
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
        lost += [v.real, v.imag] if value.imag else [v.real]
    return np.hstack(lost)


def unseen_along(
    F: np.ndarray, B: np.ndarray, H: np.ndarray, D: np.ndarray, driven: np.ndarray, read: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """Directions of the parameters that no reading along a run shows, whatever unknown loads do: parameters (k, d), and the loads
    (u, d) that make up for them; d = 0 where all parameters show.

        y(ω) = H (iω − F)⁻¹ f(ω) + r(ω),     loads read the span of H (iω − F)⁻¹ B + D

    At one instant a parameter acts as a constant load does, which no accelerometer feels; along the run it acts with the
    frequencies of the motion. y is projected across what loads read, line by line; unseen is what leaves less than UNSEEN of
    its parts.
    F (n, n) [1/s] of the motion; B (n, u), D (m, u): loads; H (m, n); driven f (s, n, k), read r (s, m, k): columns of F* and H*
    of the parameters at s instants h [s] apart. Sizes of loads are RMS.
    """
    f, r = np.fft.rfft(driven, axis=0), np.fft.rfft(read, axis=0)
    omega, k = 2 * np.pi * np.fft.rfftfreq(len(driven), h), driven.shape[-1]
    scale = balanced_units(F)
    size = np.linalg.norm(f / scale[:, None], axis=(1, 2)) + np.linalg.norm(r, axis=(1, 2))
    whole, across, made_up = np.zeros(k), [np.zeros((k, k))], [np.zeros((B.shape[1], k))]
    for i in np.argsort(-size, kind="stable")[:MOST_LINES]:
        lhs = (1j * omega[i] * np.eye(len(F)) - F) / scale[:, None] * scale
        if not omega[i] and np.linalg.cond(lhs) > 1 / RANK:
            continue  # a free structure has no static answer
        answer = np.linalg.solve(lhs, np.hstack([f[i], B]) / scale[:, None])
        y, by_loads = np.split(H * scale @ answer + np.hstack([r[i], D]), [k], axis=1)
        made_up.append(np.linalg.pinv(by_loads, rcond=RANK) @ y)
        left = y - by_loads @ made_up[-1]
        across += [left.real, left.imag]
        parts = np.abs(H * scale) @ np.abs(answer[:, :k]) + np.abs(r[i])
        whole += np.sum(parts**2, axis=0)
    per_length = np.divide(1.0, np.sqrt(whole), out=np.ones(k), where=whole > 0)
    _, sigma, Yt = np.linalg.svd(np.vstack(across) * per_length, full_matrices=False)
    parameters = per_length[:, None] * Yt[sigma <= UNSEEN].T
    parameters /= np.abs(parameters).max(axis=0, initial=1e-300)
    return np.linalg.norm(np.array(made_up) @ parameters, axis=0) / len(driven), parameters


def least_gauges(modes: MarginalModes) -> int:
    """Fewest gauges that can detect all that does not decay: the most eigenvectors at one eigenvalue."""
    return max((V.shape[1] for V in modes.vectors), default=0)


def undetectable_in_words(directions: np.ndarray, names: Sequence[str]) -> str:
    """The undetectable directions (n*, k) by the names of the unknowns they change."""
    return "; ".join(direction_in_words(column, names) for column in directions.T)


def _groups(values: np.ndarray, distance: float) -> list[np.ndarray]:
    """The values in clusters, the last one's first: a value within `distance` of a member belongs to it."""
    label = component_labels(len(values), *np.nonzero(np.abs(values[:, None] - values) <= distance))
    return [values[label == group] for group in dict.fromkeys(label[::-1].tolist())]


def _ratio(sigma: np.ndarray) -> float:
    return float(sigma[0] / sigma[-1]) if sigma[-1] > 0 else float("inf")


GROUPS = 4
ORDER = tuple(chosen for count in range(1, GROUPS + 1) for chosen in combinations(range(GROUPS), count))
"""Which of inputs, moduli, densities and damping are unknown together; the first three in the order of the tables."""


@dataclass(frozen=True)
class Case:
    """PBH at λ = 0 of one set of unknowns, at the instant of the median of its scaled condition.

    label: "input+E+rho"; unknowns: their names; found: condition, σ_min, the thesis's raw condition and the null
    direction, all of that one instant; instant: its index in the motion, −1 where there is none; instants: how many the
    median is over; reason: why it is unobservable without a computation, else empty.

    """

    label: str
    unknowns: tuple[str, ...]
    found: Observability
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
    """Every combination of unknown inputs, moduli, densities and damping at the same motion; fewer where a group is empty.

    Each is linearised at its own `linearisation_instants`; the instant of the median condition speaks for it, of an even
    number the better of the two in the middle. Inputs are random walks, whatever the filter takes them for.

    theta: all parameters [SI]; x (s, 2n) = [q, q̇], u (s, n_u) [N]: the motion; inputs, moduli, densities, damping: names;
    amplitude [N], guess [SI]: scales of the unknowns; sensed: every channel (m,); largest (m,): largest reading of the
    channel's quantity in that motion, by which its row is divided. A parameter on which the motion never depends makes its
    cases unobservable, with that as the reason.
    Raises ConfigError where a quantity reads nothing in the motion. Source: thesis (6.1), tables 6.1 and 6.2.
    """
    groups = (("input", tuple(inputs)), ("E", tuple(moduli)), ("rho", tuple(densities)), ("damping", tuple(damping)))
    if not np.all(largest > 0):
        raise ConfigError(
            f"{np.sum(~(largest > 0))} of {len(largest)} channels are of a quantity that reads nothing in the motion",
            remedy="load the structure, or leave these sensors out",
        )
    lam = modal_basis(model, model.reference)[0]
    n = model.size
    energy = float(np.sqrt(np.sum(lam * x[:, :n] ** 2 + x[:, n:] ** 2, axis=1)).max())
    scaled, plain = _compressed(sensed, 1 / np.asarray(largest)), _compressed(sensed, np.ones(len(largest)))
    found = []
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
            found.append(Case(label, unknowns.names, nothing, -1, 0, error.what))
            continue
        motion = model, unknowns, theta, x[at], u[at]
        F = linearise(*motion)
        by_size, as_is = (own.linearised(*motion, F) for own in (scaled, plain))
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
            for each, divided, raw in zip(F, by_size, as_is, strict=True)
        ]
        middle = np.argsort([result.condition for result in results], kind="stable")[(len(at) - 1) // 2]
        found.append(Case(label, unknowns.names, results[middle], int(at[middle]), len(at)))
    return tuple(found)


def _compressed(own: Sensed, factor: np.ndarray) -> Sensed:
    """Few rows for each quantity with the same HᵀH at any θ, and so the same singular values, whatever the pool; factor (m,) of
    each of its rows."""
    n, labels = own.rows.shape[1], list(own.change.terms)
    both = factor[:, None] * np.hstack([own.rows, *(own.change.terms[label] for label in labels)])
    parts = [(kind, np.linalg.qr(both[own.quantity == kind], mode="r")) for kind in np.unique(own.quantity)]
    R = np.vstack([R for _, R in parts])
    terms = {label: R[:, k * n : (k + 1) * n] for k, label in enumerate(labels, start=1)}
    change = AffineOperator(NO_CHANGE.constant, terms, own.change.coefficients)
    return Sensed(R[:, :n], np.concatenate([np.full(len(R), kind) for kind, R in parts]), change)
