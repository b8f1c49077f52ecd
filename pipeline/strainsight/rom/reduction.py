"""The reduction basis Ψ (5.2) from snapshots over a parameter box, and its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import eigh, svd

from strainsight.errors import InfeasibleError
from strainsight.fem.affine import AffineOperator
from strainsight.fem.factorisation import Factorise, factorise_free, relief_of
from strainsight.fem.model import FiniteElementModel
from strainsight.fem.modes import combine_repeated, signs
from strainsight.fem.modes import modes as lowest_modes
from strainsight.parallel import Sweep, serial
from strainsight.rom.model import Damping, ReducedModel, modal_basis

GOLDEN = (3 - 5**0.5) / 2

Theta = Mapping[str, float]


def parameter_samples(
    reference: Theta, ranges: Mapping[str, tuple[float, float]], samples: int
) -> tuple[dict[str, float], ...]:
    """The reference, then samples − 1 points of a Latin hypercube in log θ that includes both ends of every range.

    reference and ranges [SI]; the columns are ordered by the ranks of a Halton sequence, so the result is deterministic.
    Raises InfeasibleError for a range that is missing or not 0 < low ≤ high."""
    if not reference:
        return ({},)
    count = samples - 1
    return (dict(reference), *_latin(reference, ranges, np.linspace(0, 1, count) if count > 1 else np.zeros(count)))


def held_out_samples(
    reference: Theta, ranges: Mapping[str, tuple[float, float]], count: int
) -> tuple[dict[str, float], ...]:
    """A Latin hypercube at the golden section of `count` equal parts of log θ, so that it never coincides with the samples.

    Arguments and errors as in `parameter_samples`."""
    return _latin(reference, ranges, (np.arange(count) + GOLDEN) / count) if reference else ({},)


def _latin(
    reference: Theta, ranges: Mapping[str, tuple[float, float]], levels: np.ndarray
) -> tuple[dict[str, float], ...]:
    if not len(levels):
        return ()
    order = np.argsort(_halton(len(reference), len(levels)), axis=0).argsort(axis=0)
    columns = {}
    for i, name in enumerate(reference):
        if name not in ranges:
            raise InfeasibleError(f"parameter {name} has no range", remedy="Specify `range` for the parameter.")
        low, high = ranges[name]
        if not 0 < low <= high < np.inf:
            raise InfeasibleError(
                f"the range of parameter {name} is {low:g} to {high:g}",
                remedy="Specify a range with 0 < lower limit ≤ upper limit.",
            )
        columns[name] = low * (high / low) ** levels[order[:, i]]
    return tuple({name: float(column[k]) for name, column in columns.items()} for k in range(len(levels)))


def _halton(dimensions: int, count: int) -> np.ndarray:
    """Points 1 … count of the Halton sequence (count, dimensions): digits of k in base 2, 3, 5, …, reversed after the point.
    Also in scipy.stats, which takes half a second to import."""
    points = np.zeros((count, dimensions))
    primes = (p for p in range(2, 10**6) if all(p % q for q in range(2, int(p**0.5) + 1)))
    for j, base in zip(range(dimensions), primes, strict=False):
        quotient, weight = np.arange(1, count + 1), 1.0
        while quotient.any():
            quotient, digit = np.divmod(quotient, base)
            weight /= base
            points[:, j] += weight * digit
    return points


@dataclass(frozen=True)
class Snapshots:
    """frequency (m,) [Hz] and shapes (n_free, m) [1/√kg] of the lowest modes; static (n_free, n_u) [m/N]: K⁻¹S."""

    frequency: np.ndarray
    shapes: np.ndarray
    static: np.ndarray

    @property
    def vectors(self) -> np.ndarray:
        """[Φ, K⁻¹S] (n_free, m + n_u)."""
        return np.hstack([self.shapes, self.static])

    def lowest(self, modes: int) -> Snapshots:
        """The snapshots with this many modes only."""
        return Snapshots(self.frequency[:modes], self.shapes[:, :modes], self.static)


def snapshots(
    full: FiniteElementModel,
    S: np.ndarray,
    theta: Mapping[str, float],
    modes: int,
    known: tuple[np.ndarray, np.ndarray] | None = None,
) -> Snapshots:
    """K(θ)φ = ω²M(θ)φ and K(θ)⁻¹S, from one factorisation; for a free structure elastic modes and K⁺S, by inertia relief.

    S (n_free, n_u) [-] input shapes; theta [SI]; known: frequency and shapes at this θ if already computed, at least `modes` of
    them. Raises the errors of `modes` and `factorise`."""
    return snapshots_at(shared_by_all(full, S, modes), theta, known)


Shared = tuple[AffineOperator, AffineOperator, np.ndarray | None, np.ndarray, int, Factorise]


def shared_by_all(full: FiniteElementModel, S: np.ndarray, modes: int) -> Shared:
    """Common input of all tasks of a sweep over θ."""
    return full.stiffness, full.mass, full.rigid, S, modes, full.factorise


def snapshots_at(
    shared: Shared, theta: Mapping[str, float], known: tuple[np.ndarray, np.ndarray] | None = None
) -> Snapshots:
    """The snapshots as a task of a sweep: shared are stiffness, mass, rigid-body modes, S, the number of modes, and the
    factorisation."""
    stiffness, mass, rigid, S, modes, factorise = shared
    K = stiffness.at(theta)
    factor = factorise(K) if rigid is None else factorise_free(K, relief_of(mass.at(theta), rigid), factorise)
    if known is None:
        known = lowest_modes(K, mass.at(theta), modes, factor=factor, rigid=rigid)
    frequency, shapes = known
    return Snapshots(frequency[:modes], shapes[:, :modes], factor.solve(S))


def scaled(
    full: FiniteElementModel, known: Snapshots, at: Mapping[str, float], theta: Mapping[str, float]
) -> Snapshots:
    """Snapshots at θ of a model that `only_scales`, from those at another θ:  K = a K₀, M = b M₀:  ω₀√(a/b), Φ₀/√b, z₀/a."""
    a, b = (X.at(theta).diagonal().sum() / X.at(at).diagonal().sum() for X in (full.stiffness, full.mass))
    return Snapshots(known.frequency * np.sqrt(a / b), known.shapes / np.sqrt(b), known.static / a)


def only_scales(full: FiniteElementModel) -> bool:
    """Whether K(θ) and M(θ) are each a scalar times one matrix, so that modes and static responses keep their shapes."""

    def one_matrix(X: AffineOperator) -> bool:
        return not X.terms or (len(X.terms) == 1 and abs(X.constant).sum() == 0)

    return one_matrix(full.stiffness) and one_matrix(full.mass)


DEPENDENT = 1e-10
"""Part of a vector of unit energy outside a basis below which it is linearly dependent: the rest is rounding."""


@dataclass(frozen=True)
class Reduction:
    """z_free ≈ Ψ q (5.2).

    model (5.3); basis Ψ (n_free, r) [1/√kg]; frequency (modes,) [Hz] of the full model at the reference; samples the
    points of the parameter box, the reference first; static (n_free, n_u) [m/N]: K(θ₀)⁻¹S; aside (n_free, k): static responses
    that are not in Ψ."""

    model: ReducedModel
    basis: np.ndarray
    frequency: np.ndarray
    static: np.ndarray
    samples: tuple[dict[str, float], ...]
    aside: np.ndarray


@dataclass(frozen=True)
class HeldOutErrors:
    """Errors at parameter values that are not in the samples: theta (p points), frequency (p, modes) relative [-],
    static (p, n_u) [-]: ‖z − Ψq‖_K / ‖z‖_K of the static response to each input, the relative error of its strain."""

    theta: tuple[dict[str, float], ...]
    frequency: np.ndarray
    static: np.ndarray


def reduce_model(
    full: FiniteElementModel,
    S: np.ndarray,
    inputs: Sequence[str],
    reference: Theta,
    ranges: Mapping[str, tuple[float, float]],
    modes: int,
    samples: int,
    tolerance: float,
    damping: Damping,
    known: tuple[np.ndarray, np.ndarray] | None = None,
    sweep: Sweep = serial,
    aside: np.ndarray | None = None,
    slopes: Mapping[str, np.ndarray] | None = None,
) -> Reduction:
    """Modes and static responses over the parameter box, compressed in the energy inner product ⟨a, b⟩ = aᵀK(θ₀)b:

        span Ψ = span{Φ(θ₀), K(θ₀)⁻¹S} ⊕ {left singular vectors, σ > tolerance, of the rest of [Φ(θ_s), K(θ_s)⁻¹S]}
        ΨᵀM(θ₀)Ψ = I,   ΨᵀK(θ₀)Ψ = Λ

    S (n_free, n_u) [-] input shapes; inputs their names; reference θ₀ and ranges name → (low, high) [SI]; modes per
    sample; samples of the box, including the reference; tolerance [-] for snapshots of unit energy: every snapshot then has an
    error of at most tolerance·√(number dropped) in the energy norm; known: frequencies [Hz] and shapes of the reference, if
    already computed; sweep: runs the other samples; aside (n_free, k): forces whose static responses at the reference are
    computed as well, but not included in Ψ; slopes: name → ∂S/∂θ (n_free, n_u), if S depends on a parameter, S itself being that
    at the reference; Ψ covers the slopes as it covers S. The reference is never truncated, so its reduced frequencies are the
    full ones. If one material is scaled as a whole, the snapshots do not change with θ and only the reference is sampled.
    Raises InfeasibleError for a range that is missing or not positive, and the errors of `modes` and `factorise`.
    Source: thesis 5.1; Capalbo et al., parametric model order reduction by SVD of modes and static responses."""
    if samples < 1:
        raise InfeasibleError(
            f"the number of parameter samples is {samples}",
            remedy="Specify at least 1 sample: the reduction basis is computed at the reference values and at further samples.",
        )
    points = parameter_samples(reference, ranges, 1 if only_scales(full) else samples)
    n_u, slopes = S.shape[1], slopes or {}
    if not only_scales(full):  # S of loads on mass scales with the mass
        S = np.hstack([S, *(slope[:, slope.any(axis=0)] for slope in slopes.values())])
    spanned = S.shape[1]
    first = snapshots(full, S if aside is None else np.hstack([S, aside]), points[0], modes, known)
    K = full.stiffness.at(reference)  # only now, to avoid a second copy during the factorisation
    V, _ = energy_orthonormal(K, np.hstack([first.shapes, first.static[:, :spanned]]))
    rest = [sample.vectors for sample in sweep(snapshots_at, points[1:], shared_by_all(full, S, modes))]
    if rest:
        # the SVD of R instead of a Gram matrix keeps the digits of singular values below √eps
        Q, R = energy_orthonormal(K, np.hstack(rest), against=V)
        U, sigma, _ = svd(R, full_matrices=False)
        V = np.hstack([V, Q @ U[:, sigma > tolerance]])
    model, basis = _modal_coordinates(full, V, S[:, :n_u], inputs, reference, damping)
    model = replace(model, input_slope={name: basis.T @ slope for name, slope in slopes.items()})
    return Reduction(model, basis, first.frequency, first.static[:, :n_u], points, first.static[:, spanned:])


def modal_model(
    full: FiniteElementModel,
    S: np.ndarray,
    inputs: Sequence[str],
    theta: Theta,
    modes: int,
    damping: Damping,
    reference: Snapshots | None = None,
    aside: np.ndarray | None = None,
) -> tuple[ReducedModel, np.ndarray]:
    """Modes and static responses at a single θ: a model with constant operators (M = I, K = Λ) and no parameters.

    Arguments as in `reduce_model`; reference: snapshots at any other θ, used if K and M only scale, because their shapes are
    the same; aside (n_free, k): forces whose static responses are in the span too, after those of S in the snapshots. Returns
    the model and Ψ (n_free, r) [1/√kg]."""
    stiffness, mass = (AffineOperator(X.at(theta), {}) for X in (full.stiffness, full.mass))
    at_theta = replace(full, stiffness=stiffness, mass=mass)
    forces = S if aside is None else np.hstack([S, aside])
    usable = reference is not None and only_scales(full) and len(reference.frequency) >= modes
    span = reference.lowest(modes) if reference is not None and usable else snapshots(at_theta, forces, {}, modes)
    V, _ = energy_orthonormal(at_theta.stiffness.constant, span.vectors)
    return _modal_coordinates(at_theta, V, S, inputs, {}, damping)


def held_out_errors(
    full: FiniteElementModel, S: np.ndarray, reduction: Reduction, thetas: Sequence[Theta], sweep: Sweep = serial
) -> HeldOutErrors:
    """Errors of the reduced model at `thetas`: relative frequencies, and static responses in the energy norm of K(θ).

    S as in `reduce_model`. A static error ε is a relative error ε of the strain in the mean over the structure. If K and M only
    scale, the full solution follows from that of the reference by scaling; otherwise it is computed by `sweep`."""
    model, Psi, count = reduction.model, reduction.basis, len(reduction.frequency)
    if only_scales(full):
        at_reference = Snapshots(reduction.frequency, Psi[:, :0], reduction.static)
        answers = [scaled(full, at_reference, model.reference, theta) for theta in thetas]
    else:
        answers = sweep(snapshots_at, thetas, shared_by_all(full, S, count))
    frequency, static = np.zeros((len(thetas), count)), np.zeros((len(thetas), S.shape[1]))
    for i, (theta, exact) in enumerate(zip(thetas, answers, strict=True)):
        lam, _ = modal_basis(model, theta)
        frequency[i] = np.sqrt(lam[:count]) / (2 * np.pi) / exact.frequency - 1
        K = full.stiffness.at(theta)
        error = exact.static - Psi @ np.linalg.solve(model.stiffness.at(theta), model.input_shape)
        static[i] = _energy_norm(K, error) / _energy_norm(K, exact.static)
    return HeldOutErrors(tuple(dict(theta) for theta in thetas), frequency, static)


def energy_orthonormal(K: Any, X: np.ndarray, against: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Gram-Schmidt, twice, in the energy inner product:  X = Q₀C + Q R,  QᵀKQ = I,  Q₀ᵀKQ = 0.

    K (n, n) symmetric positive definite; X (n, k), scaled to unit energy here; against Q₀ (n, r) with Q₀ᵀKQ₀ = I.
    Returns Q (n, rank) and R (rank, k) of the unit-energy columns; dependent columns (below 1e-10) add no vector.
    Source: Giraud, Langou and Rozložník, Numerische Mathematik 101 (2005): two passes are enough."""
    norm = _energy_norm(K, X)
    X = X / np.where(norm > 0, norm, 1.0)
    start = 0 if against is None else against.shape[1]
    Q = np.zeros((X.shape[0], start + X.shape[1]))
    KQ = np.zeros(Q.shape)
    if against is not None:
        Q[:, :start], KQ[:, :start] = against, K @ against
    R = np.zeros((Q.shape[1], X.shape[1]))
    rank = start
    for j in range(X.shape[1]):
        w = X[:, j].copy()
        for _ in range(2):
            share = KQ[:, :rank].T @ w
            w -= Q[:, :rank] @ share
            R[:rank, j] += share
        Kw = K @ w
        remainder = float(np.sqrt(max(w @ Kw, 0.0)))
        if remainder > DEPENDENT:
            Q[:, rank], KQ[:, rank] = w / remainder, Kw / remainder
            R[rank, j] = remainder
            rank += 1
    return Q[:, start:rank], R[start:rank]


def _modal_coordinates(
    full: FiniteElementModel, V: np.ndarray, S: np.ndarray, inputs: Sequence[str], reference: Theta, damping: Damping
) -> tuple[ReducedModel, np.ndarray]:
    stiffness, mass, basis = full.stiffness.project(V), full.mass.project(V), V
    # two passes: the first brings M close to I for any spread of the frequencies, the second is accurate to rounding
    for first in (True, False):
        K, M = stiffness.at(reference), mass.at(reference)
        if first:
            inverse, Y = eigh(M, K)
            if inverse[0] <= 0:
                raise InfeasibleError(
                    "the static response to a load moves only parts without mass (smallest ratio of modal mass to modal "
                    f"stiffness: {inverse[0]:.1e} s², not positive)",
                    remedy="Specify the density of every region.",
                )
            Y = Y[:, ::-1] / np.sqrt(inverse[::-1])
        else:
            lam, Y = eigh(K, M)
        basis = basis @ Y
        if not first:
            T = combine_repeated(lam, basis)
            Y, basis = Y @ T, basis @ T
        sign = signs(basis)
        stiffness, mass, basis = stiffness.project(Y * sign), mass.project(Y * sign), basis * sign
    return ReducedModel(mass, stiffness, basis.T @ S, tuple(inputs), dict(reference), damping), basis


def _energy_norm(K: Any, X: np.ndarray) -> np.ndarray:
    """√(xᵀKx) of every column (k,)."""
    return np.sqrt(np.maximum(np.einsum("ij,ij->j", X, K @ X), 0.0))
