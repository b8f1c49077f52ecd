"""Craig-Bampton reduction of a body to its interface motions and fixed-interface modes (thesis 1.8-1.17), and its validity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.linalg import block_diag, eigh

from strainsight.errors import InfeasibleError, UserError, did_you_mean
from strainsight.fem.affine import AffineOperator
from strainsight.fem.equations import MOTIONS, rigid_rows, translation_rows
from strainsight.fem.factorisation import Factor, factorise
from strainsight.fem.mass import point_mass_matrix
from strainsight.fem.model import FiniteElementModel
from strainsight.fem.modes import combine_repeated, signs
from strainsight.fem.modes import modes as lowest_modes
from strainsight.fem.support import TOLERANCE
from strainsight.rom.inertia import scalar_mass

MOST_MODES = 384
"""Largest number of modes; more below the cut-off is considered a mistake."""
FIRST_MODES = 12
"""Number of modes of the first attempt for a cut-off frequency; doubled at every further attempt."""
DEPENDENT = 1e-9
"""Smallest share of a static response, in the energy norm, outside the modes and other vectors for a separate vector. A body with
all modes has at most 1e-12 by rounding, and dropped parts change no response by more than this."""


@dataclass(frozen=True)
class CraigBampton:
    """z_free ≈ H*q,  q = (z_b, η*, ρ)  (1.16), and K(θ)q + M q̈ = f (1.17).

    η* (modes,) are fixed-interface modes, ρ (0 … 6,) residual vectors, which are treated as modes.
    stiffness dense affine operator (n, n), one term for every Young's modulus that is a parameter; mass (n, n);
    basis H* (n_free, n); interface: node id → its three translations [m] and three rotations [rad] along the basic axes as
    rows (6, n) on q; frequency (modes,) [Hz] of the fixed-interface modes, without the residual vectors; cut [Hz]: the first
    mode that is left out, inf if none is."""

    stiffness: AffineOperator
    mass: np.ndarray
    basis: np.ndarray
    interface: Mapping[int, np.ndarray]
    frequency: np.ndarray
    cut: float


def craig_bampton(
    model: FiniteElementModel,
    interface: Sequence[int],
    *,
    modes: int | None = None,
    cutoff: float | None = None,
    reference: Mapping[str, float] | None = None,
) -> CraigBampton:
    """Constraint modes (static responses to unit motions of the interface), the lowest fixed-interface modes, and static
    responses to the inertia loads of the body with fixed interface, from one factorisation of K_ii:

        H* = [ I             0     0]      K_ii U = M_ii U Ω²,   U_rᵀM_ii U_r = I,   span [U_r V] ∋ K_ii⁻¹F_i
             [ −K_ii⁻¹K_ib   U_r   V]      K* = H*ᵀK(θ)H*,  M* = H*ᵀMH*

    F: weight along three axes, and the inertia of three angular accelerations if the supports leave a rigid-body motion; V
    is orthonormal to U_r and in itself (`residual_vectors`). With V, field and strain under gravity are exact for any number of
    modes.

    model supported or free (`build_model(…, supported=False)`); interface: ids of k nodes with six motions each (the
    reference nodes of rigid elements); modes: number of modes, may be 0; or cutoff [Hz]: all modes below it; reference θ₀:
    parameter name → value [SI] at which H* is computed. K* is affine in θ as K is; static responses are exact at θ₀, and at
    all θ if one modulus scales the whole stiffness. Rigid-body motions that the supports leave are in H* without error.
    A frequency f well below the cut f_c is too high by at most the share ½(f/f_c)², the energy share of the omitted modes.
    Measured: within 0.5 % up to half the cut for a hub with at least 20 modes.

    Raises UserError for a node that does not exist, is named twice, or does not have six free and independent motions, for
    densities that are parameters, for neither or both of modes and cutoff; InfeasibleError for a wrong number of modes; and
    the errors of `factorise` and `modes`, also if the interface does not constrain the motions that the supports leave.
    Source: thesis 1.8-1.17; Craig and Bampton, AIAA Journal 6 (1968)."""
    if (modes is None) == (cutoff is None):
        raise UserError(
            "the reduction of a body requires either a number of modes or a cut-off frequency",
            remedy="Specify exactly one of `modes` and `cutoff` for the body.",
        )
    if model.mass.parameters:
        raise UserError(
            f"parameter {model.mass.parameters[0]} is a density of a moving body, but the inertia of the body must be constant",
            remedy="Remove the density from the parameters; specify a fixed density of the material.",
        )
    b, unit = interface_motions(model, interface)
    i = np.setdiff1d(np.arange(model.size), b)
    if missing := [name for name in model.stiffness.parameters if name not in (reference or {})]:
        raise UserError(
            f"parameter {missing[0]} has no reference value",
            remedy="Specify in `reference` the parameter value at which the body is reduced.",
        )
    K, M = sparse.csr_array(model.stiffness.at(reference or {})), model.mass.constant
    K_i = sparse.csr_array(K[i])
    R = rigid_motions(model)
    F = own_inertia(model, R.shape[1])
    H = np.zeros((model.size, len(b)))
    H[b] = unit
    H[i], shapes, frequency, cut = _interior(
        sparse.csr_array(K_i[:, i]), sparse.csr_array(M[i][:, i]), K_i[:, b] @ unit, F[i], modes, cutoff
    )
    # rigid-body motions R that the supports leave: H R_b = R up to the rounding of the solver, which this removes
    R_b = np.linalg.solve(unit, R[b])
    H += (R - H @ R_b) @ np.linalg.pinv(R_b)
    interior_shapes = np.zeros((model.size, shapes.shape[1]))
    interior_shapes[i] = shapes
    H = np.hstack([H, interior_shapes])
    rows = {node: np.eye(6, H.shape[1], 6 * k) for k, node in enumerate(interface)}
    mass = AffineOperator(M, {}).project(H).constant
    return CraigBampton(model.stiffness.project(H), mass, H, rows, frequency, cut)


def floating_basis(body: CraigBampton, node: int) -> CraigBampton:
    """A free body in a frame fixed to an interface node: the shapes for which this node does not move.

        q = (0 on the six motions of the node, the others)

    The motion of the floating frame is then the only rigid-body motion, and K* is positive definite. The frame may have any
    origin and, in the undeformed state, the basic axes; the rows of the node are zero. Raises UserError for a node that is not an
    interface, and if a frame is already fixed.
    Source: Shabana, Dynamics of Multibody Systems, ch. 5 (reference conditions)."""
    is_fixed = rows_of(body, node).any(axis=0)
    if fixed := [other for other, rows in body.interface.items() if not rows.any()]:
        raise UserError(
            f"the floating frame of the body is already fixed to node {fixed[0]}",
            remedy="Fix the floating frame to only one node.",
        )
    remaining = np.flatnonzero(~is_fixed)
    square = np.ix_(remaining, remaining)
    return replace(
        body,
        stiffness=body.stiffness.of_all(lambda X: X[square]),
        mass=body.mass[square],
        basis=body.basis[:, remaining],
        interface={other: rows[:, remaining] for other, rows in body.interface.items()},
    )


def rows_of(body: CraigBampton, node: int) -> np.ndarray:
    """Six motions of an interface node on q (6, n). Raises UserError for any other node."""
    if node not in body.interface:
        known = ", ".join(map(str, body.interface))
        raise UserError(
            f"node {node} is not an interface node of the reduced body",
            remedy=did_you_mean(str(node), map(str, body.interface), f"Use one of the interface nodes {known}."),
        )
    return body.interface[node]


def rigid_motions(model: FiniteElementModel) -> np.ndarray:
    """The rigid-body motions that supports and ties leave, on the free motions (n_free, 0 … 6):

        z = r c = T z_free   for c in the null space of T r_free − r

    r the six rigid-body motions of all nodes (`rigid_field`), r_free their free rows."""
    constraint = model.constraint
    T, r = constraint.transform, rigid_field(model)
    r_free = constraint.along_local_axes(sparse.csr_array(r)).toarray()[constraint.free_rows]
    # nodes without elements have no free motion, and do not count
    used = model.mesh.nodes_of_elements
    counts = np.diff(T.indptr) > 0
    counts[translation_rows(used)] = True
    _, strength, Vt = np.linalg.svd(np.linalg.qr((T @ r_free - r)[counts], mode="r"))
    return r_free @ Vt[strength <= TOLERANCE].T


def own_inertia(model: FiniteElementModel, loose: int) -> np.ndarray:
    """Inertia loads (n_free, 3 or 6) of a body; without rigid-body motions no angular ones."""
    return inertia_loads(model)[:, : 6 if loose else 3]


def interface_motions(model: FiniteElementModel, interface: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Columns b (6k,) of T of the interface motions z_b, and their values (6k, 6k) for unit z_b."""
    if len(interface) == 0:
        raise UserError(
            "the reduced body has no interface node",
            remedy="Specify the nodes of joints and forces as interface nodes.",
        )
    columns: list[np.ndarray] = []
    blocks = []
    for k, node in enumerate(interface):
        if node in interface[:k]:
            raise UserError(f"interface node {node} is named twice", remedy="List the node only once.")
        part = model.constraint.transform[motion_rows(model, node)]
        columns_of_node = np.unique(part.tocoo().col)
        if (is_fixed := np.diff(part.indptr) == 0).any():
            raise UserError(
                f"interface node {node} is clamped in {MOTIONS[int(np.argmax(is_fixed))]}",
                remedy="Remove the node from the supports or from the interface.",
            )
        if len(columns_of_node) != 6 or np.isin(columns_of_node, np.concatenate([columns_of_node[:0], *columns])).any():
            raise UserError(
                f"the six motions of interface node {node} are not independent: the node depends on other nodes or is clamped",
                remedy="Use the reference node of an RBE2 as interface, or tie the connected surface to this node by an RBE2.",
            )
        columns.append(columns_of_node)
        blocks.append(np.linalg.inv(part[:, columns_of_node].toarray()))
    return np.concatenate(columns), block_diag(*blocks)


def motion_rows(model: FiniteElementModel, node: int) -> np.ndarray:
    """Rows (6,) of z of the three translations and three rotations of a node. Raises UserError for a node without rotations."""
    index = model.mesh.node_index(node)
    if (turning := model.constraint.reference_rows.get(index)) is None:
        raise UserError(
            f"interface node {node} has no rotations, because it is not the reference node of a rigid element",
            remedy="Tie the connected surface to this node by an RBE2, in the deck or under mesh.ties.",
        )
    return np.concatenate([translation_rows([index]), turning + np.arange(3)])


def _interior(
    K: sparse.csr_array, M: sparse.csr_array, load: np.ndarray, F: np.ndarray, modes: int | None, cutoff: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """−K⁻¹ load, [U V], frequencies of U and the cut; K, M (n_i, n_i) and loads (n_i, ·) of the interior with fixed interface."""
    most = int(np.count_nonzero(M.diagonal() > 0))
    if modes is not None and not 0 <= modes <= most:
        raise InfeasibleError(
            f"{modes} modes are requested, but the body has only {most} degrees of freedom apart from its interface nodes",
            remedy=f"Request 0 to {most} modes.",
        )
    if cutoff is not None and not cutoff > 0:
        raise InfeasibleError(f"the cut-off frequency is {cutoff:g} Hz", remedy="Specify a positive cut-off frequency.")
    if len(F) == 0:  # rigid elements leave nothing between the interfaces
        return -load, np.zeros((0, 0)), np.zeros(0), np.inf
    factor = factorise(K)
    frequency, U, cut = _fixed_interface_modes(K, M, factor, modes, cutoff, most)
    return -factor.solve(load), np.hstack([U, residual_vectors(F, M, factor, frequency, U)]), frequency, cut


def _fixed_interface_modes(
    K: sparse.csr_array, M: sparse.csr_array, factor: Factor, modes: int | None, cutoff: float | None, most: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies, shapes and the first omitted frequency, of at most `most` modes."""
    count = min(FIRST_MODES if modes is None else modes + 1, most)
    while True:
        frequency, U = lowest_modes(K, M, count, factor=factor)
        if cutoff is None or frequency[-1] > cutoff or count == most:
            break
        if count >= MOST_MODES:
            raise InfeasibleError(
                f"more than {count} modes are below the cut-off frequency {cutoff:g} Hz (mode {count}: {frequency[-1]:.4g} Hz)",
                remedy="Reduce `cutoff` of the body, or specify `modes` instead.",
            )
        count = min(2 * count, most)
    selected = int(modes) if modes is not None else int(np.count_nonzero(frequency <= cutoff))
    cut = float(frequency[selected]) if selected < len(frequency) else np.inf
    return frequency[:selected], U[:, :selected], cut


def rigid_field(model: FiniteElementModel) -> np.ndarray:
    """Three translations and three rotations of all nodes, constrained or not, r (3n + 3r, 6) on the rows of z [m or rad per m]:

    about the mean of the nodes of the elements, rotations divided by its radius, so that all six have the same size."""
    constraint, x = model.constraint, model.mesh.position
    used = model.mesh.nodes_of_elements
    arm = x - x[used].mean(axis=0)
    r = np.zeros((constraint.transform.shape[0], 6))
    r[: 3 * len(x)] = rigid_rows(arm).reshape(-1, 6)
    for row in constraint.reference_rows.values():
        r[row : row + 3, 3:] = np.eye(3)
    r[:, 3:] /= np.linalg.norm(arm[used], axis=1).max()
    return r


def inertia_loads(model: FiniteElementModel) -> np.ndarray:
    """F = Tᵀ(m ⊗ I₃ + M_p) r  (n_free, 6) [N per m/s²]: weight along x, y, z, and the inertia of three angular accelerations.

    m the mass of all nodes and M_p that of the point masses: the mass of clamped nodes acts on others through their elements, but
    is not in the mass of the free motions. r of `rigid_field`."""
    r, n = rigid_field(model), len(model.mesh.position)
    f = np.zeros_like(r)
    f[: 3 * n] = (scalar_mass(model.mesh) @ r[: 3 * n].reshape(n, -1)).reshape(3 * n, -1)
    if model.mesh.point_masses:
        f += point_mass_matrix(model.mesh, model.constraint.reference_rows) @ r
    return np.asarray(model.constraint.transform.T @ f)


def residual_vectors(
    F: np.ndarray, M: sparse.csr_array, factor: Factor, frequency: np.ndarray, U: np.ndarray
) -> np.ndarray:
    """Shapes V that add the static responses K⁻¹F to modes U, KU = MUΩ² and UᵀMU = I, as additional modes:

        R = K⁻¹(F − MUUᵀF) = K⁻¹F − UΩ⁻²UᵀF      span V = span R,     VᵀMV = I,   VᵀKV diagonal,   VᵀMU = VᵀKU = 0

    F (n, k) [N per m/s²], M (n, n), factor of K, frequency (m,) [Hz] and U (n, m) [1/√kg] → V (n, ≤ k) [1/√kg], by ascending
    Rayleigh quotient; fewer if a response is in the modes and the previous vectors up to `DEPENDENT`.
    Source: Rose, MSC World Users' Conference (1991); Dickens, Nakagawa and Wittbrodt, Computers and Structures 62 (1997)."""
    P = U.T @ F
    # solving for the remaining load, instead of subtracting modes from the response, keeps small vectors accurate
    remainder = F - M @ (U @ P)
    R = factor.solve(remainder)
    R -= U @ (U.T @ (M @ R))
    energy = np.einsum("ij,ij->j", R, remainder) + ((P / (2 * np.pi * frequency[:, None])) ** 2).sum(
        axis=0
    )  # diag FᵀK⁻¹F
    shapes: list[np.ndarray] = []
    loads: list[np.ndarray] = []
    for x, f, whole in zip(R.T, remainder.T, energy, strict=True):
        for _ in range(2):  # a second pass removes the rounding
            for y, g in zip(shapes, loads, strict=True):
                share = y @ f
                x, f = x - share * y, f - share * g
        strain_energy = float(x @ f)
        if strain_energy > DEPENDENT**2 * whole:
            shapes.append(x / np.sqrt(strain_energy))
            loads.append(f / np.sqrt(strain_energy))
    if not shapes:
        return np.zeros((len(F), 0))
    Y = np.column_stack(shapes)  # YᵀKY = I
    inverse, W = eigh(Y.T @ (M @ Y))
    inverse, W = inverse[::-1], W[:, ::-1]
    W = W @ combine_repeated(inverse, Y @ W)
    V = Y @ (W / np.sqrt(inverse))
    return V * signs(V)


OFF = 0.01
"""Share of the energy of an interface motion by which the reduced body may be too stiff."""
FACTOR = 2.0
"""Factor of a modulus at which the excess is evaluated; below, it grows with the square of the logarithm."""
NEGLIGIBLE = 1e-10
"""Share of the stiffness of elements at an interface below which a motion requires no work."""


def reach(
    model: FiniteElementModel, body: CraigBampton, interface: Sequence[int], reference: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Modulus → lowest and highest value [Pa] at which the reduced body is valid, with the others at θ₀.

        max_v vᵀ(S* − S)v / vᵀS*v ≤ 1 %,   S = K_bb − K_bi K_ii⁻¹ K_ib   of K(θ), S* the same of K*(θ)

    and the same for responses to the inertia loads of the body (`excess`).

    The basis of θ₀ is exact for all θ if one modulus scales the whole stiffness: (0, ∞). Otherwise S* − S ≥ 0 begins with the
    square of the change of θ; it is evaluated at 2θ₀ and θ₀/2, which bound the range."""
    names = model.stiffness.parameters
    if len(names) == 1 and abs(model.stiffness.constant).max() == 0:
        return {names[0]: (0.0, np.inf)}
    ranges = {}
    for name in names:
        nominal = reference[name]
        ends = []
        for factor in (1 / FACTOR, FACTOR):
            e = excess(model, body, interface, {**reference, name: factor * nominal})
            ends.append(nominal * factor ** min(1.0, np.sqrt(OFF / e) if e > 0 else 1.0))
        ranges[name] = (float(ends[0]), float(ends[1]))
    return ranges


def excess(
    model: FiniteElementModel, body: CraigBampton, interface: Sequence[int], theta: Mapping[str, float]
) -> float:
    """Largest relative excess of stiffness of the reduced body at θ [-]: in the energy of an interface motion, and in the
    response to inertia loads with fixed interface,  1 − min_F FᵀH_r(K*_rr)⁻¹H_rᵀF / FᵀK_ii⁻¹F."""
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
    stiff = _least_ratio(whole - toward.T @ solved[:, :n], full[:n, :n] - c.T @ np.linalg.solve(r, c), np.diag(whole))
    compliance, on = F.T @ solved[:, n:], body.basis[i, n:].T @ F
    soft = _least_ratio(on.T @ np.linalg.solve(r, on), compliance, np.diag(compliance))
    return max(1 - stiff, 1 - soft, 0.0)


def _least_ratio(A: np.ndarray, B: np.ndarray, diagonal: np.ndarray) -> float:
    """min vᵀAv/vᵀBv over v with vᵀBv > 0 (not for rigid motions); 1 without any. diagonal: its zeros mark unused rows."""
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.inf))
    size, shapes = eigh(B * np.outer(scale, scale))
    works = size > NEGLIGIBLE
    W = scale[:, None] * shapes[:, works] / np.sqrt(size[works])
    return float(np.linalg.eigvalsh(W.T @ A @ W)[0]) if works.any() else 1.0
