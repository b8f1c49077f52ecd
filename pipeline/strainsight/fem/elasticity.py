"""Stiffness of materials and layers at points of elements, and stiffness and mass of many elements of one kind at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from strainsight.errors import DeckError
from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.by_region import interpolated
from strainsight.fem.shells import shell_axes
from strainsight.fem.shells_and_beams import material_angle, plies_of, ply_stiffness
from strainsight.mesh.anisotropic import Anisotropic, CompositeSolid
from strainsight.mesh.facets import UPPER, Facets, on_solids
from strainsight.mesh.kinds import FACETS, kind_of
from strainsight.mesh.kinds.kind import ElementKind, Rule
from strainsight.mesh.model import CellBlock, Material, Mesh
from strainsight.mesh.properties import PLY_MODULI, shapes, with_value
from strainsight.mesh.thin import Lamina, ShellBlock

SHEARS = ((0, 1), (1, 2), (2, 0))
AT_ONCE = 256
"""Elements whose strains at all points (at most 27) are in memory at a time."""


def element_stiffnesses(kind: ElementKind, position: np.ndarray, nu: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Stiffness of isotropic elements with unit modulus:

        K_ab = ∫ λ g_a g_bᵀ + μ g_b g_aᵀ + μ (g_a·g_b) I dV,    g_a = J⁻ᵀ ∂N_a/∂ξ,
        λ = ν/((1 + ν)(1 − 2ν)),   μ = 1/(2(1 + ν))

    Incompatible modes P of a kind follow its nodes with the gradients of `bubble_gradients`, whose mean is zero so that
    the patch test is passed; they are condensed: K_uu − K_ua K_aa⁻¹ K_au.

    position (e, k, 3) [m]; nu (e,) [-]; ids (e,) for the error message. Returns (e, k(k+1)/2, 9) [m], the 3 × 3 blocks
    of the node pairs a ≤ b in the order of numpy.triu_indices. Raises DeckError where |J| ≤ 0, naming the elements."""
    xi, w = kind.stiffness
    g, det = gradients(kind, position, xi, ids)
    if kind.bubble_gradient:
        g = np.concatenate([g, bubble_gradients(kind, position, xi, det)], axis=2)
    size = g.shape[2]
    flat = (g * np.sqrt(w * det)[:, :, None, None]).reshape(len(position), len(w), 3 * size)
    outer = np.matmul(flat.swapaxes(1, 2), flat).reshape(-1, size, 3, size, 3)
    lam, mu = (constant[:, None, None, None] for constant in lame(nu))
    if kind.bubble_gradient:
        K = _isotropic(outer.transpose(0, 1, 3, 2, 4), lam[..., None], mu[..., None])
        K = _condense(K, len(kind.nodes))
        a, b = np.triu_indices(len(kind.nodes))
        return K[:, a, b].reshape(len(position), -1, 9)
    a, b = np.triu_indices(size)
    pairs = outer[:, a, :, b, :].swapaxes(0, 1)
    return _isotropic(pairs, lam, mu).reshape(len(position), -1, 9)


def anisotropic_stiffnesses(
    kind: ElementKind, position: np.ndarray, C: np.ndarray, ids: np.ndarray, rule: Rule
) -> np.ndarray:
    """Stiffness of anisotropic elements, K = ∫ BᵀCB dV, with the strain B z in the order xx yy zz xy yz zx, γ = 2ε.

    position (e, k, 3) [m]; C (e, q, 6, 6) [Pa] along the basic axes at the points of the rule, or (e, 1, 6, 6) if constant in
    an element; incompatible modes, ids and errors as in `element_stiffnesses`. Returns (e, k(k+1)/2, 9) [N/m]."""
    xi, w = rule
    k = len(kind.nodes)
    a, b = np.triu_indices(k)
    K = np.empty((len(position), len(a), 9))
    step = max(1, 27 * AT_ONCE // max(27, len(w)))
    for start in range(0, len(position), step):
        elements = slice(start, start + step)
        g, det = gradients(kind, position[elements], xi, ids[elements])
        if kind.bubble_gradient:
            g = np.concatenate([g, bubble_gradients(kind, position[elements], xi, det)], axis=2)
        e, q, size = g.shape[:3]
        B = symmetric_gradient(g).reshape(e, q, 6, 3 * size)
        stress = np.matmul(C[elements] * (w * det)[:, :, None, None], B)
        dense = np.matmul(B.reshape(e, 6 * q, -1).swapaxes(1, 2), stress.reshape(e, 6 * q, -1))
        blocks = dense.reshape(e, size, 3, size, 3).swapaxes(2, 3)
        if kind.bubble_gradient:
            blocks = _condense(blocks, k)
        K[elements] = blocks[:, a, b].reshape(e, -1, 9)
    return K


def element_masses(kind: ElementKind, position: np.ndarray, ids: np.ndarray, rule: Rule | None = None) -> np.ndarray:
    """Consistent mass with unit density, m_ab = ∫ N_a N_b dV; the mass of the three components is m ⊗ I₃.

    position (e, k, 3) [m]; ids (e,) for the error message; rule: default that of the kind, weights may include a density.
    Returns (e, k(k+1)/2, 1) [m³] of the node pairs a ≤ b. Raises DeckError where |J| ≤ 0, naming the elements."""
    xi, w = kind.mass if rule is None else rule
    _, det = jacobians(kind, position, xi, ids)
    N = kind.shape(xi)
    a, b = np.triu_indices(N.shape[1])
    return ((det * w) @ (N[:, a] * N[:, b]))[:, :, None]


def jacobians(
    kind: ElementKind, position: np.ndarray, xi: np.ndarray, ids: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """J = ∂x/∂ξ (e, q, 3, 3) [m] with J[d, c] = ∂x_c/∂ξ_d, and |J| (e, q) [m³].

    Raises DeckError where |J| ≤ 0, naming the elements."""
    J = np.einsum("qkd,ekc->eqdc", kind.gradient(xi), position, optimize=True)
    det = np.linalg.det(J)
    size = np.ptp(position, axis=1).max(axis=1)[:, None] ** 3
    if (bad := ~(det > 1e-12 * size).all(axis=1)).any():
        worst = int(np.argmin(det.min(axis=1) / size[:, 0]))
        names = ", ".join(str(id) for id in ids[bad][:5]) + (", …" if bad.sum() > 5 else "")
        raise DeckError(
            f"flat or inverted {kind.name} elements ({bad.sum()} in total): {names} "
            f"(smallest Jacobian determinant {det[worst].min():.3g} m³ in element {ids[worst]})",
            remedy="Check the node order and the mid-side nodes of these elements.",
            entity=("element", int(ids[worst])),
        )
    return J, det


def gradients(
    kind: ElementKind, position: np.ndarray, xi: np.ndarray, ids: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """g_a = J⁻ᵀ ∂N_a/∂ξ (e, q, k, 3) [1/m] and |J| (e, q) [m³]."""
    J, det = jacobians(kind, position, xi, ids)
    return np.matmul(kind.gradient(xi), np.linalg.inv(J).swapaxes(2, 3)), det


def positions(kind: ElementKind, position: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """x = Σ_a N_a x_a (e, q, 3) [m] of elements position (e, k, 3) at ξ (q, 3)."""
    return np.einsum("qk,ekc->eqc", kind.shape(xi), position)


def symmetric_gradient(g: np.ndarray) -> np.ndarray:
    """[εxx εyy εzz γxy γyz γzx] per component of the displacement of each node: g (e, q, k, 3) → (e, q, 6, k, 3)."""
    B = np.zeros((*g.shape[:2], 6, *g.shape[2:]))
    for i in range(3):
        B[:, :, i, :, i] = g[..., i]
    for row, (i, j) in enumerate(SHEARS, start=3):
        B[:, :, row, :, i] = g[..., j]
        B[:, :, row, :, j] = g[..., i]
    return B


def bubble_gradients(kind: ElementKind, position: np.ndarray, xi: np.ndarray, det: np.ndarray) -> np.ndarray:
    """(|J₀|/|J|) J₀⁻ᵀ ∂P/∂ξ (e, q, p, 3) [1/m] of the incompatible modes, J₀ at the centre (Taylor et al. 1976)."""
    assert kind.bubble_gradient is not None
    J = np.einsum("qkd,ekc->eqdc", kind.gradient(kind.centre), position)[:, 0]
    g = np.einsum("qid,ecd->eqic", kind.bubble_gradient(xi), np.linalg.inv(J))
    return g * (np.linalg.det(J)[:, None] / det)[:, :, None, None]


def lame(nu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """λ = ν/((1 + ν)(1 − 2ν)) and μ = 1/(2(1 + ν)) of unit modulus."""
    return nu / ((1 + nu) * (1 - 2 * nu)), 0.5 / (1 + nu)


def _isotropic(outer: np.ndarray, lam: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """λ G + μ Gᵀ + μ tr(G) I for blocks G = ∫ g_a g_bᵀ (..., 3, 3)."""
    trace = np.trace(outer, axis1=-2, axis2=-1)[..., None, None]
    return lam * outer + mu * outer.swapaxes(-1, -2) + mu * trace * np.eye(3)


def _condense(K: np.ndarray, nodes: int) -> np.ndarray:
    """K_uu − K_ua K_aa⁻¹ K_au of blocks (e, k, k, 3, 3) whose first `nodes` stay."""
    e, k = K.shape[:2]
    dense = K.transpose(0, 1, 3, 2, 4).reshape(e, 3 * k, 3 * k)
    u = 3 * nodes
    condensed = dense[:, :u, :u] - dense[:, :u, u:] @ np.linalg.solve(dense[:, u:, u:], dense[:, u:, :u])
    return condensed.reshape(e, nodes, 3, nodes, 3).transpose(0, 1, 3, 2, 4)


PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
"""Components of a symmetric tensor in the order of VTK: xx yy zz xy yz zx."""


def pair(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """½(a bᵀ + b aᵀ) (m, 6) of a and b (m, 3), as stress: xx yy zz xy yz zx."""
    return np.stack([0.5 * (a[:, i] * b[:, j] + a[:, j] * b[:, i]) for i, j in PAIRS], axis=1)


def rotate_stiffness(C: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """C along the basic axes (m, 6, 6) of C (6, 6) or (m, 6, 6) along others, axes (m, 3, 3) one in a column:

        C' = R C Rᵀ,     σ' = R σ,   ε = Rᵀ ε',   γ = 2ε

    so that column k of R is the stress tensor a_i ⊗ a_j, made symmetric and of the shears twice, of the k-th pair of axes."""
    columns = [(1.0 if i == j else 2.0) * pair(axes[:, :, i], axes[:, :, j]) for i, j in PAIRS]
    R = np.stack(columns, axis=2)
    return np.asarray(R @ C @ R.swapaxes(1, 2))


def isotropic_stiffness(material: Material) -> np.ndarray:
    """C (6, 6) [Pa] of E and ν, shears γ."""
    shear = material.youngs_modulus / (2 * (1 + material.poisson_ratio))
    C = shear * np.diag([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])
    C[:3, :3] += 2 * shear * material.poisson_ratio / (1 - 2 * material.poisson_ratio)
    return C


def anisotropic_regions(mesh: Mesh) -> list[int]:
    """Ids of the regions of solids whose material is anisotropic or one of several layers, ascending."""
    return sorted(n for n in mesh.regions if mesh.anisotropic_of(n) is not None or n in mesh.composites)


def elasticities(mesh: Mesh, kind: ElementKind, position: np.ndarray, region: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """C [Pa] along the basic axes at points ξ (q, 3) of elements position (e, k, 3) [m] in regions (e,) of `anisotropic_regions`.

    Shape (e, q, 6, 6), of a composite solid that of the layer at ξ; (e, 1, 6, 6) if constant in every element."""
    numbers = np.unique(region).tolist()
    x = positions(kind, position, xi if any(_varies(mesh, number) for number in numbers) else xi[:1])
    C = np.empty((*x.shape[:2], 6, 6))
    for number in numbers:
        in_region = region == number
        C[in_region] = _in_region(mesh, number, x[in_region], xi)
    return C


def _varies(mesh: Mesh, region: int) -> bool:
    """Whether the material of a region, or its orientation, varies within an element."""
    orientation = mesh.orientations.get(region)
    return region in mesh.composites or (orientation is not None and orientation.varies)


def _in_region(mesh: Mesh, region: int, x: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """C (e, q, 6, 6) at x (e, q, 3), the points ξ (q, 3) of elements of one region."""
    composite, orientation = mesh.composites.get(region), mesh.orientations.get(region)
    e, q = x.shape[:2]
    if composite is None:
        material = mesh.anisotropic_of(region)
        assert material is not None
        if orientation is None:
            return np.broadcast_to(material.stiffness, (e, q, 6, 6))
        return rotate_stiffness(material.stiffness, orientation.axes_at(x.reshape(-1, 3))).reshape(e, q, 6, 6)
    C, at = np.empty((e, q, 6, 6)), composite.layer_at(xi)
    for i, layer in enumerate(mesh.layer_materials(region)):
        here = at == i
        if isinstance(layer, Anisotropic):
            axes = composite.layers[i].orientation.axes_at(x[:, here].reshape(-1, 3))
            C[:, here] = rotate_stiffness(layer.stiffness, axes).reshape(e, -1, 6, 6)
        else:
            assert layer is not None
            C[:, here] = isotropic_stiffness(layer)
    return C


def by_rule(mesh: Mesh, kind: ElementKind, region: np.ndarray) -> Iterator[tuple[np.ndarray, Rule]]:
    """Elements (m,) of regions (e,) that `anisotropic_regions` names, and the rule of their stiffness: that of their kind, for
    composite solids one with points in every layer."""
    layered = np.isin(region, list(mesh.composites))
    plain = np.flatnonzero(np.isin(region, anisotropic_regions(mesh)) & ~layered)
    if len(plain):
        yield plain, kind.stiffness
    for number in np.unique(region[layered]).tolist():
        yield np.flatnonzero(region == number), layered_rule(kind.stiffness, mesh.composites[number])


def layered_rule(rule: Rule, composite: CompositeSolid) -> Rule:
    """Rule with as many points along each layer as `rule` has, and its points across: exact for the same polynomials in each
    layer. `rule` is a product of one along the direction of the layers and one across."""
    xi, w = rule
    points, weights = [], []
    for low, high in pairwise(composite.ends.tolist()):
        layer_points = xi.copy()
        layer_points[:, composite.direction] = 0.5 * (low + high) + 0.5 * (high - low) * xi[:, composite.direction]
        points.append(layer_points)
        weights.append(0.5 * (high - low) * w)
    return np.concatenate(points), np.concatenate(weights)


def relative_masses(mesh: Mesh, part: CellBlock, kind: ElementKind) -> np.ndarray:
    """∫ (ρ/ρ̄) N_a N_b dV [m³] (e, pairs) of elements and their node pairs a ≤ b, ρ the density of the layer, ρ̄ that of the
    region. For a lumped mass, on the diagonal only, see `lumped`."""
    m = _consistent(mesh, part, kind)
    return lumped(m, part.nodes.shape[1]) if mesh.lumped else m


def lumped(m: np.ndarray, k: int) -> np.ndarray:
    """Diagonal masses of elements from their consistent ones m (e, pairs) of the pairs a ≤ b of k nodes [m³ or kg],

        m_a = m_aa Σ_bc m_bc / Σ_b m_bb,    0 off the diagonal

    the diagonal scaled to the mass of the element (Hinton, Rock and Zienkiewicz 1976), so that all are positive, also
    for quadratic elements."""
    a, b = np.triu_indices(k)
    on = a == b
    diagonal = np.where(on, m, 0.0)
    return np.asarray(diagonal * (m @ np.where(on, 1.0, 2.0) / diagonal.sum(axis=1))[:, None])


def _consistent(mesh: Mesh, part: CellBlock, kind: ElementKind) -> np.ndarray:
    position = mesh.position[part.nodes]
    if not (layered := np.isin(part.region, list(mesh.composites))).any():
        return element_masses(kind, position, part.ids)[:, :, 0]
    m = np.empty((len(part.ids), position.shape[1] * (position.shape[1] + 1) // 2))
    if not layered.all():
        m[~layered] = element_masses(kind, position[~layered], part.ids[~layered])[:, :, 0]
    for number in np.unique(part.region[layered]).tolist():
        in_region, composite, mean = part.region == number, mesh.composites[number], mesh.density_of(number)
        xi, w = layered_rule(kind.mass, composite)
        if mean:
            rho = np.array([0.0 if each is None else each.density for each in mesh.layer_materials(number)])
            w = w * rho[composite.layer_at(xi)] / mean
        m[in_region] = element_masses(kind, position[in_region], part.ids[in_region], (xi, w))[:, :, 0]
    return m


@dataclass(frozen=True)
class FacetLaws:
    """Material laws at the facets (m,) on laminates, anisotropic and composite solids, ascending.

    stiffness (m, 6, 6) [Pa]: strain → stress in the order of `facet_strain`, shears γ; of a laminate that of the ply at the
    face, in plane stress, affine in the free moduli of plies; of a composite solid that of the layer at the facet centre.
    contraction (m, 3, 3): c of ε_nn = −c : ε across the face of a laminate, at the references; 0 on solids, whose strain is
    known. A deck does not define ν₁₃ and ν₂₃ of plies: ε_nn assumes ν₁₃ = ν₂₃ = ν₁₂. Stress, and the strain along the face
    that gauges measure, do not depend on it."""

    facet: np.ndarray
    stiffness: AffineOperator
    contraction: np.ndarray


def facet_laws(mesh: Mesh, facets: Facets, parameters: Sequence[Parameter] = ()) -> FacetLaws | None:
    """None where no facet is on a laminate, a shell of several materials, an anisotropic or a composite solid."""
    free = [
        replace(
            parameter, regions=tuple(number for number in parameter.regions if shapes(mesh, number, "youngs_modulus"))
        )
        for parameter in parameters
        if parameter.property in ("youngs_modulus", *PLY_MODULI)
    ]
    free = [parameter for parameter in free if parameter.regions]

    def at(theta: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        other = mesh
        for parameter in free:
            other = with_value(other, parameter.property, parameter.regions, theta[parameter.name], parameter.material)
        parts = [*(_laws_of_shells(other, block, facets) for block in other.shells), _laws_of_solids(other, facets)]
        facet, stiffness, contraction = (np.concatenate([part[i] for part in parts]) for i in range(3))
        order = np.argsort(facet)
        return facet[order], stiffness[order], contraction[order]

    facet, stiffness, contraction = at({parameter.name: parameter.reference for parameter in free})
    if not len(facet):
        return None
    if not free:
        return FacetLaws(facet, AffineOperator(stiffness, {}), contraction)
    unknown = np.isnan(stiffness)  # of shells of several materials; nothing free changes them
    C = interpolated(lambda theta: np.where(unknown, 0.0, at(theta)[1]), free)
    return FacetLaws(facet, replace(C, constant=np.where(unknown, np.nan, C.constant)), contraction)


def _laws_of_solids(mesh: Mesh, facets: Facets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Laws of solids at the facet centres; for composite solids of the layer there."""
    anisotropic = np.isin(facets.region, anisotropic_regions(mesh)) & ~facets.of(mesh.thin)
    C = np.empty((len(anisotropic), 6, 6))
    for block, local, which, row in on_solids(mesh, facets):
        here, kind, facet = anisotropic[which], kind_of(block.kind), FACETS[facets.kind[which[0]]]
        if here.any():
            xi = facet.shape(facet.centre) @ kind.nodes[list(local)]
            element = row[here]
            position, region = mesh.position[block.nodes[element]], block.region[element]
            C[which[here]] = elasticities(mesh, kind, position, region, xi)[:, 0]
    return np.flatnonzero(anisotropic), C[anisotropic], np.zeros((int(anisotropic.sum()), 3, 3))


def _laws_of_shells(mesh: Mesh, block: ShellBlock, facets: Facets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    numbers = [int(number) for number in np.unique(block.region)]
    laminates = [number for number in numbers if mesh.laminate(number) is not None]
    general = {number: shell for number in numbers if (shell := mesh.general_shell(number)) is not None}
    which = np.flatnonzero(np.isin(facets.region, [*laminates, *general]) & np.isin(facets.element_id, block.ids))
    C, c = np.zeros((len(which), 6, 6)), np.zeros((len(which), 3, 3))
    if not len(which):
        return which, C, c
    order = np.argsort(block.ids)
    row = order[np.searchsorted(block.ids, facets.element_id[which], sorter=order)]
    axes = shell_axes(mesh.position[block.nodes], block.ids)[row]
    turn, upper = material_angle(mesh, block)[row], facets.facet[which] == UPPER
    for number in laminates:
        laminate, materials = mesh.laminate(number), plies_of(mesh, number)
        assert laminate is not None
        for here, end in ((upper, -1), (~upper, 0)):
            on_end = np.flatnonzero((block.region[row] == number) & here)
            angle = turn[on_end] + np.radians(laminate.plies[end].angle)
            one, two = _rotate_axes(axes[on_end], angle)
            Q, ply = ply_stiffness(materials[end]), materials[end]
            C[on_end] = _stiffness_along(one, two, Q)
            if isinstance(ply, Lamina):
                share = ply.nu12 / ply.e1 * Q[0] + ply.nu12 / ply.e2 * Q[1]
            else:
                share = ply.poisson_ratio / ply.youngs_modulus * (Q[0] + Q[1])
            c[on_end] = share[0] * one[:, :, None] * one[:, None] + share[1] * two[:, :, None] * two[:, None]
    for number, shell in general.items():
        on_end = np.flatnonzero(block.region[row] == number)
        one, two = _rotate_axes(axes[on_end], turn[on_end])
        C[on_end] = _stiffness_along(one, two, shell.membrane) if shell.uniform else np.nan
        S = np.linalg.inv(shell.membrane)
        share = -(S[0, 1] * shell.membrane[0] + S[0, 1] * S[1, 1] / S[0, 0] * shell.membrane[1])
        tensor = np.array([[share[0], share[2]], [share[2], share[1]]])
        both = np.stack([one, two], axis=2)
        c[on_end] = both @ tensor @ both.swapaxes(1, 2)
    return which, C, c


def _rotate_axes(axes: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x and y (m, 3) of axes (m, 3, 3), rotated by angles (m,) [rad] about their z."""
    x, y = axes[:, :, 0], axes[:, :, 1]
    one = np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * y
    return one, np.cos(angle)[:, None] * y - np.sin(angle)[:, None] * x


def _stiffness_along(one: np.ndarray, two: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Q (3, 3) of plane stress along directions (m, 3) as (m, 6, 6) along the basic axes."""
    R = np.stack([pair(one, one), pair(two, two), 2 * pair(one, two)], axis=2)
    return np.asarray(R @ Q @ R.swapaxes(1, 2))
