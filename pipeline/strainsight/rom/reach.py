"""How far moduli may lie from where a body was reduced: what its interfaces feel of shapes that are those of other moduli."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import sparse
from scipy.linalg import eigh

from strainsight.fem.factorisation import factorise
from strainsight.fem.model import FiniteElementModel
from strainsight.rom.craig_bampton import CraigBampton, interface_motions, own_inertia, rigid_motions

OFF = 0.01
"""Share of the energy of a motion of the interfaces by which the reduced body may be too stiff."""
FACTOR = 2.0
"""How far a modulus is moved to see: within, the excess grows with the square of its logarithm."""
NONE = 1e-10
"""Share of the stiffness of elements beside an interface below which a motion takes no work."""


def reach(
    model: FiniteElementModel, body: CraigBampton, interface: Sequence[int], reference: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Modulus → lowest and highest value [Pa] at which the reduced body is good, the others at θ₀.

        max_v vᵀ(S* − S)v / vᵀS*v ≤ 1 %,   S = K_bb − K_bi K_ii⁻¹ K_ib   of K(θ), S* the same of K*(θ)

    and the same of responses to the body's own inertia (`excess`).

    A basis of θ₀ has the shapes of θ wherever one modulus scales all stiffness: (0, ∞). Elsewhere S* − S ≥ 0 begins with the
    square of what θ moves by; it is taken at 2θ₀ and θ₀/2, which bound the range.
    """
    names = model.stiffness.parameters
    if len(names) == 1 and abs(model.stiffness.constant).max() == 0:
        return {names[0]: (0.0, np.inf)}
    found = {}
    for name in names:
        own = reference[name]
        ends = []
        for factor in (1 / FACTOR, FACTOR):
            e = excess(model, body, interface, {**reference, name: factor * own})
            ends.append(own * factor ** min(1.0, np.sqrt(OFF / e) if e > 0 else 1.0))
        found[name] = (float(ends[0]), float(ends[1]))
    return found


def excess(
    model: FiniteElementModel, body: CraigBampton, interface: Sequence[int], theta: Mapping[str, float]
) -> float:
    """Largest share by which the reduced body is too stiff at θ [-]: of the energy of a motion of the interfaces, and of what
    the body's own inertia does with them held,  1 − min_F FᵀH_r(K*_rr)⁻¹H_rᵀF / FᵀK_ii⁻¹F."""
    b, unit = interface_motions(model, interface)
    i, n = np.setdiff1d(np.arange(model.size), b), len(b)
    if not len(i):
        return 0.0
    K = sparse.csr_array(model.stiffness.at(theta))
    toward, F = K[i][:, b] @ unit, own_inertia(model, rigid_motions(model).shape[1])[i]
    solved = factorise(sparse.csr_array(K[i][:, i])).solve(np.hstack([toward, F]))
    whole = unit.T @ (K[b][:, b] @ unit)
    full = body.stiffness.at(theta)
    r, c = full[n:, n:], full[n:, :n]
    stiff = _least(whole - toward.T @ solved[:, :n], full[:n, :n] - c.T @ np.linalg.solve(r, c), np.diag(whole))
    compliance, on = F.T @ solved[:, n:], body.basis[i, n:].T @ F
    soft = _least(on.T @ np.linalg.solve(r, on), compliance, np.diag(compliance))
    return max(1 - stiff, 1 - soft, 0.0)


def _least(A: np.ndarray, B: np.ndarray, diagonal: np.ndarray) -> float:
    """min vᵀAv/vᵀBv over the v that B is not zero for, as of rigid motions; 1 where there is none. diagonal: what is none."""
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.inf))
    size, shapes = eigh(B * np.outer(scale, scale))
    works = size > NONE
    W = scale[:, None] * shapes[:, works] / np.sqrt(size[works])
    return float(np.linalg.eigvalsh(W.T @ A @ W)[0]) if works.any() else 1.0
