"""The reduction basis Ψ (5.2) over a box of parameters, and what it leaves out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import eigh, svd

from strainsight.errors import InfeasibleError
from strainsight.fem.affine import AffineOperator
from strainsight.fem.model import FiniteElementModel
from strainsight.fem.modes import signs, turned
from strainsight.parallel.sweep import Sweep, serial
from strainsight.rom.model import Damping, ReducedModel, modal_basis
from strainsight.rom.samples import Theta, parameter_samples
from strainsight.rom.snapshots import Snapshots, only_scales, scaled, shared_by_all, snapshots, snapshots_at

DEPENDENT = 1e-10
"""A vector of unit energy whose part outside a basis is below this lies in it: the rest is rounding of the solver."""


@dataclass(frozen=True)
class Reduction:
    """z_free ≈ Ψ q (5.2).

    model (5.3); basis Ψ (n_free, r) [1/√kg]; frequency (modes,) [Hz] of the full model at the reference; samples the
    points of the parameter box, the reference first; singular_value (s,) [-] of the part of the other samples'
    snapshots (each of unit energy) that the reference's modes and static responses do not hold: those above the
    tolerance are in Ψ; static (n_free, n_u) [m/N]: K(θ₀)⁻¹S; aside (n_free, k): static responses that are not in Ψ.
    """

    model: ReducedModel
    basis: np.ndarray
    frequency: np.ndarray
    static: np.ndarray
    samples: tuple[dict[str, float], ...]
    singular_value: np.ndarray
    aside: np.ndarray


@dataclass(frozen=True)
class HeldOutErrors:
    """Errors at parameter values that the basis has not seen: theta (p points), frequency (p, modes) relative [-],
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
    sample; samples of the box, the reference among them; tolerance [-] beside snapshots of unit energy: every snapshot
    is then held to tolerance·√(number dropped) in the energy norm; known: frequencies [Hz] and shapes of the reference,
    where they have been found; sweep: runs the samples beside the reference; aside (n_free, k): forces whose static
    responses at the reference are found as well, and left out of Ψ; slopes: name → ∂S/∂θ (n_free, n_u), where S changes with a
    parameter, S itself being that at the reference: what they load is in Ψ as S is. The reference is never truncated, so its
    reduced frequencies are the full ones. Where one material is scaled as a whole the snapshots do not change with θ and the
    reference is sampled alone.
    Raises InfeasibleError for a range that is missing or not positive, and the errors of `modes` and `factorise`.
    Source: thesis 5.1; Capalbo et al., parametric model order reduction by SVD of modes and static responses.
    """
    if samples < 1:
        raise InfeasibleError(f"{samples} parameter samples", remedy="take at least 1, the reference")
    points = parameter_samples(reference, ranges, 1 if only_scales(full) else samples)
    n_u, slopes = S.shape[1], slopes or {}
    if not only_scales(full):  # where all mass does, S of what acts on it does, too
        S = np.hstack([S, *(slope[:, slope.any(axis=0)] for slope in slopes.values())])
    spanned = S.shape[1]
    first = snapshots(full, S if aside is None else np.hstack([S, aside]), points[0], modes, known)
    K = full.stiffness.at(reference)  # not before: beside the factor there would be two of it
    V, _ = energy_orthonormal(K, np.hstack([first.shapes, first.static[:, :spanned]]))
    rest = [found.vectors for found in sweep(snapshots_at, points[1:], shared_by_all(full, S, modes, V))]
    sigma = np.zeros(0)
    if rest:
        V, sigma = _compress(K, V, np.hstack(rest), tolerance)
    model, basis = _modal_coordinates(full, V, S[:, :n_u], inputs, reference, damping)
    model = replace(model, input_slope={name: basis.T @ slope for name, slope in slopes.items()})
    return Reduction(model, basis, first.frequency, first.static[:, :n_u], points, sigma, first.static[:, spanned:])


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
    """Modes and static responses at one θ alone: a truth with constant operators (M = I, K = Λ) and no parameters.

    Arguments as in `reduce_model`; reference: snapshots at any other θ, which serve where K and M only scale, as their
    shapes are the same there; aside (n_free, k): forces whose static responses are in the span too, those of S in the
    snapshots in front of theirs. Returns the model and Ψ (n_free, r) [1/√kg].
    """
    frozen = FiniteElementModel(
        full.mesh,
        full.constraint,
        AffineOperator(full.stiffness.at(theta), {}),
        AffineOperator(full.mass.at(theta), {}),
        full.rigid,
        full.factorise,
    )
    forces = S if aside is None else np.hstack([S, aside])
    serves = reference is not None and only_scales(full) and len(reference.frequency) >= modes
    span = reference.lowest(modes) if reference is not None and serves else snapshots(frozen, forces, {}, modes)
    V, _ = energy_orthonormal(frozen.stiffness.constant, span.vectors)
    return _modal_coordinates(frozen, V, S, inputs, {}, damping)


def held_out_errors(
    full: FiniteElementModel, S: np.ndarray, reduction: Reduction, thetas: Sequence[Theta], sweep: Sweep = serial
) -> HeldOutErrors:
    """What the reduced model misses at `thetas`: relative frequencies, and static responses in the energy norm of K(θ).

    S as given to `reduce_model`. A static error ε is a relative error ε of the strain in the mean over the structure. Where
    K and M only scale, the full model's answer there is that of the reference, scaled; else it is solved for by `sweep`.
    """
    model, Psi, count = reduction.model, reduction.basis, len(reduction.frequency)
    if only_scales(full):
        at_reference = Snapshots(reduction.frequency, Psi[:, :0], reduction.static)
        answers = [scaled(full, at_reference, model.reference, theta) for theta in thetas]
    else:
        answers = sweep(snapshots_at, thetas, shared_by_all(full, S, count, Psi))
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
    Source: Giraud, Langou and Rozložník, Numerische Mathematik 101 (2005): twice is enough.
    """
    norm = _energy_norm(K, X)
    X = X / np.where(norm > 0, norm, 1.0)
    start = 0 if against is None else against.shape[1]
    Q = np.zeros((X.shape[0], start + X.shape[1]))
    if against is not None:
        Q[:, :start] = against
    KQ = K @ Q
    R = np.zeros((Q.shape[1], X.shape[1]))
    rank = start
    for j in range(X.shape[1]):
        w = X[:, j].copy()
        for _ in range(2):
            share = KQ[:, :rank].T @ w
            w -= Q[:, :rank] @ share
            R[:rank, j] += share
        left = float(_energy_norm(K, w[:, None])[0])
        if left > DEPENDENT:
            Q[:, rank] = w / left
            KQ[:, rank] = K @ Q[:, rank]
            R[rank, j] = left
            rank += 1
    return Q[:, start:rank], R[start:rank]


def _compress(K: Any, V: np.ndarray, X: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    # The SVD of R, not of a Gram matrix: singular values keep their digits below √eps.
    Q, R = energy_orthonormal(K, X, against=V)
    U, sigma, _ = svd(R, full_matrices=False)
    return np.hstack([V, Q @ U[:, sigma > tolerance]]), sigma


def _modal_coordinates(
    full: FiniteElementModel, V: np.ndarray, S: np.ndarray, inputs: Sequence[str], reference: Theta, damping: Damping
) -> tuple[ReducedModel, np.ndarray]:
    stiffness, mass, basis = full.stiffness.project(V), full.mass.project(V), V
    # Twice: the first pass brings M near I, whatever the spread of the frequencies; the second has no digit to lose.
    for first in (True, False):
        K, M = stiffness.at(reference), mass.at(reference)
        if first:
            inverse, Y = eigh(M, K)
            if inverse[0] <= 0:
                raise InfeasibleError(
                    f"a static response moves no mass (m/k = {inverse[0]:.1e} s²)", remedy="give every region a density"
                )
            Y = Y[:, ::-1] / np.sqrt(inverse[::-1])
        else:
            lam, Y = eigh(K, M)
        basis = basis @ Y
        if not first:
            T = turned(lam, basis)
            Y, basis = Y @ T, basis @ T
        sign = signs(basis)
        stiffness, mass, basis = stiffness.project(Y * sign), mass.project(Y * sign), basis * sign
    return ReducedModel(mass, stiffness, basis.T @ S, tuple(inputs), dict(reference), damping), basis


def _energy_norm(K: Any, X: np.ndarray) -> np.ndarray:
    """√(xᵀKx) of every column (k,)."""
    return np.sqrt(np.maximum(np.einsum("ij,ij->j", X, K @ X), 0.0))
