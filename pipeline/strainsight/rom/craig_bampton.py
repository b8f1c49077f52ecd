"""A body reduced to the motions of its interface nodes and its modes with these held (thesis 1.8-1.17), and its reach."""

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
from strainsight.fem.modes import modes as lowest_modes
from strainsight.fem.modes import signs, turned
from strainsight.fem.support import TOLERANCE
from strainsight.rom.inertia import scalar_mass

MOST_MODES = 384
"""Modes after which a cut-off is taken for a mistake."""
FIRST_MODES = 12
"""Modes of the first attempt where a frequency says how many are wanted; twice as many at every further one."""
DEPENDENT = 1e-9
"""Least share of a static response, in the energy norm, that modes and other vectors must leave for a vector of its own: a
body whose modes are all kept leaves at most 1e-12 by rounding, and what is dropped changes no response by more than this."""


@dataclass(frozen=True)
class CraigBampton:
    """z_free ≈ H*q,  q = (z_b, η*, ρ)  (1.16), and K(θ)q + M q̈ = f (1.17).

    η* (modes,) are modes with the interface held, ρ (0 … 6,) residual vectors, which look like modes and are none.
    stiffness dense affine operator (n, n), one term for every Young's modulus that is a parameter; mass (n, n);
    basis H* (n_free, n); interface: node id → its three translations [m] and three rotations [rad] along the basic axes as
    rows (6, n) on q; frequency (modes,) [Hz] of the modes with the interface held, without the residual vectors; cut [Hz]:
    the first mode that was left out, inf where none was.
    """

    stiffness: AffineOperator
    mass: np.ndarray
    basis: np.ndarray
    interface: Mapping[int, np.ndarray]
    frequency: np.ndarray
    cut: float

    @property
    def size(self) -> int:
        """n."""
        return self.basis.shape[1]


def craig_bampton(
    model: FiniteElementModel,
    interface: Sequence[int],
    *,
    modes: int | None = None,
    cutoff: float | None = None,
    reference: Mapping[str, float] | None = None,
) -> CraigBampton:
    """Static responses to unit motions of the interface, the lowest modes with it held, and static responses to the body's
    own inertia with it held, from one factorisation of K_ii:

        H* = [ I             0     0]      K_ii U = M_ii U Ω²,   U_rᵀM_ii U_r = I,   span [U_r V] ∋ K_ii⁻¹F_i
             [ −K_ii⁻¹K_ib   U_r   V]      K* = H*ᵀK(θ)H*,  M* = H*ᵀMH*

    F: weight along three axes, and the inertia of three angular accelerations where the supports leave a rigid motion; V
    is orthonormal to U_r and within itself (`residual_vectors`). Field and strain under gravity are exact by V, whatever
    the number of modes.

    model supported or free (`build_model(…, supported=False)`); interface: ids of k nodes with six motions each (the
    reference nodes of rigid elements); modes: how many, 0 for none; or cutoff [Hz]: all below it; reference θ₀
    parameter name → value [SI], where H* is taken. K* is affine in θ as K is; static responses are exact at θ₀, and at
    all θ where one modulus scales the whole. A motion that the supports leave free is in H* without error.
    A frequency f well below the cut f_c is too high, by at most ½(f/f_c)² of itself: what the modes left out hold of the
    energy of its mode. Measured: within 0.5 % up to half the cut on a hub with 20 modes and more.

    Raises UserError for a node that is not there, is named twice, lacks one of the six motions or has it held or tied,
    for densities that are parameters, for neither or both of modes and cutoff; InfeasibleError for a wrong number of
    modes; and the errors of `factorise` and `modes`, as where the interface does not hold what the supports leave free.
    Source: thesis 1.8-1.17; Craig and Bampton, AIAA Journal 6 (1968).
    """
    if (modes is None) == (cutoff is None):
        raise UserError("a reduction takes either a number of modes or a cut-off frequency", remedy="give one of them")
    if model.mass.parameters:
        raise UserError(
            f"the density {model.mass.parameters[0]} is a parameter of a body in motion, whose inertia is constant",
            remedy="leave it out of the parameters, or give the material its density",
        )
    b, unit = interface_motions(model, interface)
    i = np.setdiff1d(np.arange(model.size), b)
    if missing := [name for name in model.stiffness.parameters if name not in (reference or {})]:
        raise UserError(f"parameter {missing[0]} has no reference value", remedy="give the value to reduce the body at")
    K, M = sparse.csr_array(model.stiffness.at(reference or {})), model.mass.constant
    K_i = sparse.csr_array(K[i])
    R = rigid_motions(model)
    F = own_inertia(model, R.shape[1])
    H = np.zeros((model.size, len(b)))
    H[b] = unit
    H[i], shapes, frequency, cut = _interior(
        sparse.csr_array(K_i[:, i]), sparse.csr_array(M[i][:, i]), K_i[:, b] @ unit, F[i], modes, cutoff
    )
    # the rigid motions R that the supports leave: H R_b = R up to the rounding of the solver, which this takes away
    R_b = np.linalg.solve(unit, R[b])
    H += (R - H @ R_b) @ np.linalg.pinv(R_b)
    held = np.zeros((model.size, shapes.shape[1]))
    held[i] = shapes
    H = np.hstack([H, held])
    rows = {node: np.eye(6, H.shape[1], 6 * k) for k, node in enumerate(interface)}
    mass = AffineOperator(M, {}).project(H).constant
    return CraigBampton(model.stiffness.project(H), mass, H, rows, frequency, cut)


def floating_basis(body: CraigBampton, node: int) -> CraigBampton:
    """A free body seen from a frame that is fixed to an interface node: the shapes that leave this node where it is.

        q = (0 on the six motions of the node, the others)

    The motion of the floating frame is then the only rigid one and K* positive definite. The frame has its origin anywhere
    and, where nothing is deformed, the basic axes; the node's own rows are zero. Raises UserError for a node that is not an
    interface and where a frame is fixed already.
    Source: Shabana, Dynamics of Multibody Systems, ch. 5 (reference conditions).
    """
    held = rows_of(body, node).any(axis=0)
    fixed = [other for other, rows in body.interface.items() if not rows.any()]
    if fixed:
        raise UserError(f"the frame of the body is fixed to node {fixed[0]} already", remedy="fix it to one node only")
    stay = np.flatnonzero(~held)
    square = np.ix_(stay, stay)
    return replace(
        body,
        stiffness=body.stiffness.of_all(lambda X: X[square]),
        mass=body.mass[square],
        basis=body.basis[:, stay],
        interface={other: rows[:, stay] for other, rows in body.interface.items()},
    )


def rows_of(body: CraigBampton, node: int) -> np.ndarray:
    """Six motions of an interface node on q (6, n). Raises UserError for any other node."""
    if node not in body.interface:
        known = ", ".join(map(str, body.interface))
        raise UserError(
            f"node {node} is not an interface of the reduced body",
            remedy=did_you_mean(str(node), map(str, body.interface), f"its interface nodes are {known}"),
        )
    return body.interface[node]


def rigid_motions(model: FiniteElementModel) -> np.ndarray:
    """The rigid motions that supports and ties leave, on the free motions (n_free, 0 … 6):

        z = r c = T z_free   for c in the null space of T r_free − r

    r the six motions of everything (`rigid_field`), r_free their free rows.
    """
    constraint = model.constraint
    T, r = constraint.transform, rigid_field(model)
    r_free = constraint.along_own_axes(sparse.csr_array(r)).toarray()[constraint.free_rows]
    # what no element holds has no free motion, and stays behind without harm
    used = model.mesh.nodes_of_elements
    counts = np.diff(T.indptr) > 0
    counts[translation_rows(used)] = True
    _, strength, Vt = np.linalg.svd(np.linalg.qr((T @ r_free - r)[counts], mode="r"))
    return r_free @ Vt[strength <= TOLERANCE].T


def own_inertia(model: FiniteElementModel, loose: int) -> np.ndarray:
    """Loads (n_free, 3 or 6) of a body's own inertia; one that cannot turn (no rigid motion is loose) has no angular one."""
    return inertia_loads(model)[:, : 6 if loose else 3]


def interface_motions(model: FiniteElementModel, interface: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Columns b (6k,) of T that the motions z_b of the interface rest on, and their values (6k, 6k) for unit z_b."""
    if len(interface) == 0:
        raise UserError("a reduction without an interface node", remedy="name the nodes that joints and forces hold")
    columns: list[np.ndarray] = []
    blocks = []
    for k, node in enumerate(interface):
        if node in interface[:k]:
            raise UserError(f"interface node {node} is named twice", remedy="name it once")
        part = model.constraint.transform[motion_rows(model, node)]
        found = np.unique(part.tocoo().col)
        held = np.diff(part.indptr) == 0
        if held.any():
            raise UserError(
                f"interface node {node} is held in {MOTIONS[int(np.argmax(held))]}",
                remedy="take it out of the supports, or out of the interface",
            )
        if len(found) != 6 or np.isin(found, np.concatenate([found[:0], *columns])).any():
            raise UserError(
                f"the six motions of interface node {node} are not its own: it follows other nodes or is held",
                remedy="name the node that it and they follow, or tie the flange to it by an RBE2",
            )
        columns.append(found)
        blocks.append(np.linalg.inv(part[:, found].toarray()))
    return np.concatenate(columns), block_diag(*blocks)


def motion_rows(model: FiniteElementModel, node: int) -> np.ndarray:
    """Rows (6,) of z of a node's three translations and three rotations. Raises UserError where it has no rotations."""
    index = model.mesh.node_index(node)
    turning = model.constraint.reference_rows.get(index)
    if turning is None:
        raise UserError(
            f"interface node {node} has no rotations: it is not the reference of a rigid element",
            remedy="tie the flange to it by an RBE2, in the deck or under mesh.ties",
        )
    return np.concatenate([translation_rows([index]), turning + np.arange(3)])


def _interior(
    K: sparse.csr_array,
    M: sparse.csr_array,
    load: np.ndarray,
    F: np.ndarray,
    modes: int | None,
    cutoff: float | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """−K⁻¹ load, [U V] and of U the frequencies and the cut; K, M (n_i, n_i) and loads (n_i, ·) of the held interior."""
    most = int(np.count_nonzero(M.diagonal() > 0))
    if modes is not None and not 0 <= modes <= most:
        raise InfeasibleError(
            f"{modes} modes of a body with {most} unknowns between its interfaces", remedy=f"ask for 0 to {most}"
        )
    if cutoff is not None and not cutoff > 0:
        raise InfeasibleError(f"a cut-off at {cutoff:g} Hz", remedy="it must be positive")
    if len(F) == 0:  # rigid elements leave nothing between the interfaces
        return -load, np.zeros((0, 0)), np.zeros(0), np.inf
    factor = factorise(K)
    frequency, U, cut = _held_modes(K, M, factor, modes, cutoff, most)
    return -factor.solve(load), np.hstack([U, residual_vectors(F, M, factor, frequency, U)]), frequency, cut


def _held_modes(
    K: sparse.csr_array, M: sparse.csr_array, factor: Factor, modes: int | None, cutoff: float | None, most: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies, shapes and the first frequency left out, of at most so many modes."""
    count = min(FIRST_MODES if modes is None else modes + 1, most)
    while True:
        frequency, U = lowest_modes(K, M, count, factor=factor)
        if cutoff is None or frequency[-1] > cutoff or count == most:
            break
        if count >= MOST_MODES:
            raise InfeasibleError(
                f"more than {count} modes lie below {cutoff:g} Hz (the last is at {frequency[-1]:.4g} Hz)",
                remedy="lower the cut-off, or state a number of modes",
            )
        count = min(2 * count, most)
    kept = int(modes) if modes is not None else int(np.count_nonzero(frequency <= cutoff))
    cut = float(frequency[kept]) if kept < len(frequency) else np.inf
    return frequency[:kept], U[:, :kept], cut


def rigid_field(model: FiniteElementModel) -> np.ndarray:
    """Three translations and three rotations of everything, held or not, r (3n + 3r, 6) on the rows of z [m or rad per m]:

    about the middle of the elements' nodes, rotations divided by its radius, so that all six are of one size.
    """
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

    m the mass of all nodes and M_p that of the points: the mass that hangs on held nodes by its elements pulls on the
    others too, and is not in the mass of the free motions. r of `rigid_field`.
    """
    r, n = rigid_field(model), len(model.mesh.position)
    f = np.zeros_like(r)
    f[: 3 * n] = (scalar_mass(model.mesh) @ r[: 3 * n].reshape(n, -1)).reshape(3 * n, -1)
    if model.mesh.point_masses:
        f += point_mass_matrix(model.mesh, model.constraint.reference_rows) @ r
    return np.asarray(model.constraint.transform.T @ f)


def residual_vectors(
    F: np.ndarray, M: sparse.csr_array, factor: Factor, frequency: np.ndarray, U: np.ndarray
) -> np.ndarray:
    """Shapes V that add the static responses K⁻¹F to modes U, KU = MUΩ² and UᵀMU = I, as modes of their own:

        R = K⁻¹(F − MUUᵀF) = K⁻¹F − UΩ⁻²UᵀF      span V = span R,     VᵀMV = I,   VᵀKV diagonal,   VᵀMU = VᵀKU = 0

    F (n, k) [N per m/s²], M (n, n), factor of K, frequency (m,) [Hz] and U (n, m) [1/√kg] → V (n, ≤ k) [1/√kg], by rising
    Rayleigh quotient; fewer where a response is in the modes and the vectors before it but for `DEPENDENT`.
    Source: Rose, MSC World Users' Conference (1991); Dickens, Nakagawa and Wittbrodt, Computers and Structures 62 (1997).
    """
    P = U.T @ F
    # solving for what is left of the load, not taking modes off the response, keeps small vectors accurate
    left = F - M @ (U @ P)
    R = factor.solve(left)
    R -= U @ (U.T @ (M @ R))
    energy = np.einsum("ij,ij->j", R, left) + ((P / (2 * np.pi * frequency[:, None])) ** 2).sum(axis=0)  # diag FᵀK⁻¹F
    shapes: list[np.ndarray] = []
    loads: list[np.ndarray] = []
    for x, f, whole in zip(R.T, left.T, energy, strict=True):
        for _ in range(2):  # once more, for what rounding leaves
            for y, g in zip(shapes, loads, strict=True):
                share = y @ f
                x, f = x - share * y, f - share * g
        own = float(x @ f)
        if own > DEPENDENT**2 * whole:
            shapes.append(x / np.sqrt(own))
            loads.append(f / np.sqrt(own))
    if not shapes:
        return np.zeros((len(F), 0))
    Y = np.column_stack(shapes)  # YᵀKY = I
    inverse, W = eigh(Y.T @ (M @ Y))
    inverse, W = inverse[::-1], W[:, ::-1]
    W = W @ turned(inverse, Y @ W)
    V = Y @ (W / np.sqrt(inverse))
    return V * signs(V)


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
