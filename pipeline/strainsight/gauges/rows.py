"""What a strain gauge reads of a displacement field."""

from __future__ import annotations

import numpy as np

from strainsight.errors import InfeasibleError
from strainsight.fem.elements import centre, shape_gradient
from strainsight.gauges.candidates import Candidates
from strainsight.gauges.surface import by_kind, facet_points, normals

OVERHANG = 0.2
"""Share of the local coordinates' range by which a misplaced gauge may leave its facet; the strain is extrapolated."""


def strain_rows(
    position: np.ndarray,
    candidates: Candidates,
    field: np.ndarray,
    *,
    offset: np.ndarray | None = None,
    rotation: np.ndarray | None = None,
) -> np.ndarray:
    """Strain of every gauge in every displacement field, from the facet's own shape functions:

        ε = dᵀ sym(∇z) d = d·(∂z/∂s),    ∂Nₖ/∂s = d · J(JᵀJ)⁻¹ ∂Nₖ/∂ξ,    J = ∂x/∂ξ

    d is tangent to the facet, so the surface gradient is all of ∇z that counts.
    position (n, 3) [m]; candidates (m); field (3n, r) [m per unit], row 3·node + component; offset (m, 2) [m] along
    (d, n × d) and rotation (m,) [deg], right-handed about the normal, misplace the gauges; d follows a curved facet.
    Returns (m, r) [1 per unit]. Raises InfeasibleError where an offset leads off its facet by more than 20 % of it.
    """
    z = np.asarray(field).reshape(len(position), 3, -1)
    rows = np.zeros((len(candidates), z.shape[2]))
    for name, which, nodes in by_kind(candidates.kind, candidates.nodes):
        own = candidates.take(which)
        corners = position[nodes]
        xi = np.tile(centre(name), (len(which), 1))
        if offset is not None:
            xi = _moved(name, corners, own, np.asarray(offset, dtype=float)[which])
        _, J = facet_points(name, corners, xi)
        turn = np.zeros(len(which)) if rotation is None else np.deg2rad(np.asarray(rotation, dtype=float)[which])
        d = _turned(own.direction, normals(J), turn)
        # d in the dual base of the tangents: solve (JᵀJ) s = Jᵀd.
        s = np.linalg.solve(np.swapaxes(J, 1, 2) @ J, np.einsum("mca,mc->ma", J, d)[..., None])
        slope = (shape_gradient(name, xi) @ s)[..., 0]
        for k in range(nodes.shape[1]):
            rows[which] += slope[:, k, None] * np.einsum("mc,mcr->mr", d, z[nodes[:, k]])
    return rows


def _turned(direction: np.ndarray, n: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The direction laid on the plane of n and turned by angle [rad] about it, (m, 3) unit."""
    d = direction - np.sum(direction * n, axis=1)[:, None] * n
    d /= np.linalg.norm(d, axis=1)[:, None]
    return np.cos(angle)[:, None] * d + np.sin(angle)[:, None] * np.cross(n, d)


def _moved(name: str, corners: np.ndarray, own: Candidates, offset: np.ndarray) -> np.ndarray:
    """Local coordinates ξ of the point at the offset, (x(ξ) − x_c)·[d, n × d] = offset, by Newton's method."""
    plane = np.stack([own.direction, np.cross(own.normal, own.direction)], axis=1)
    size = np.linalg.norm(corners.max(axis=1) - corners.min(axis=1), axis=1)
    xi = np.tile(centre(name), (len(corners), 1))
    for _ in range(25):
        x, J = facet_points(name, corners, xi)
        miss = offset - np.einsum("mac,mc->ma", plane, x - own.position)
        # A step of at most half the local range: a far offset is to be refused, not to overflow.
        step = np.clip(np.linalg.solve(plane @ J, miss[..., None])[..., 0], -0.5, 0.5)
        xi = xi + step
        found = np.abs(miss).max(axis=1) < 1e-9 * size
        if found.all():
            break
    if name.startswith("tri"):
        beyond = np.maximum(-xi.min(axis=1), xi.sum(axis=1) - 1)
    else:
        beyond = (np.abs(xi).max(axis=1) - 1) / 2
    off = ~found | (beyond > OVERHANG)
    if off.any():
        first = np.flatnonzero(off)[0]
        raise InfeasibleError(
            f"{np.count_nonzero(off)} gauges misplaced by {np.linalg.norm(offset[first]):.3g} m leave "
            f"their facet (element {own.element[first]}, facet {own.facet[first]}, {size[first]:.3g} m across)",
            remedy="misplace them less, or use a coarser surface mesh",
        )
    return xi
