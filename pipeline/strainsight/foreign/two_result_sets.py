"""Reduced model of a parameter, from modes and responses that another program computed at two values of it.

With U₀ = [Φ₀, z₀] at θ₀ and U₁ = [Φ₁, z₁] at θ₁, the mass M of our mesh and the loads f

    A U₀ = [M Φ₀Λ₀, f],     B U₁ = [M Φ₁Λ₁, f],     K(θ) = A + (θ − θ₀)/(θ₁ − θ₀) D,     D = B − A.

On U = [U₀, U₁] the blocks U₀ᵀAU₀, U₁ᵀBU₁ and N = U₀ᵀDU₁ = U₀ᵀBU₁ − U₀ᵀAU₁ are known. The blocks U₀ᵀDU₀ and U₁ᵀDU₁ are not known,
and both sets are reproduced for any values of them. D is the strain energy of the region alone. For an isotropic material it is
c₁K̃₁ + c₂K̃₂. K̃ is the stiffness of our elements with unit modulus and two Poisson's ratios. A least-squares fit to N
determines c. The rest S = N − U₀ᵀK̃U₁ enters through the motion of the region, U₁ ≈ U₀a and U₀ ≈ U₁b:

    U₁ᵀDU₁ = U₁ᵀK̃U₁ + (aᵀS + Sᵀa)/2,     U₀ᵀDU₀ = U₀ᵀK̃U₀ + (Sb + bᵀSᵀ)/2

For a density, D follows from our mass, and A is known on all of U."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.linalg import eigh

from strainsight.errors import UserError
from strainsight.fem.affine import AffineOperator, Parameter, of_stiffness
from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.constraints import Constraint, describe_row
from strainsight.fem.mass import has_mass, mass_product
from strainsight.fem.model import FiniteElementModel, FullModel
from strainsight.foreign.imported_modes import (
    DIGITS,
    Forces,
    ImportedMotion,
    Results,
    as_operator,
    as_sparse,
    check_responses,
    describe_responses,
    forces_on_rows,
    independent_directions,
    normalise_results,
    unresolved_rows,
)
from strainsight.mesh.model import Material, Mesh, Region
from strainsight.mesh.properties import with_value

KEY = "mesh.results.second"


@dataclass(frozen=True)
class Change:
    """The parameter, whose regions are those of the second set, and its values [SI] in the first and the second set."""

    parameter: Parameter
    first: float
    second: float


@dataclass(frozen=True)
class Observed:
    """One set: motions U (3n + 3r, m + s) of unit energy, their forces X U (same shape), λ (m,) [rad²/s²], frequency
    [Hz], rounding error and notes."""

    motion: np.ndarray
    force: np.ndarray
    lam: np.ndarray
    frequency: np.ndarray
    rounding: float
    notes: tuple[str, ...]


def check_supports(mesh: Mesh, imported: tuple[ImportedMotion, ImportedMotion]) -> None:
    """Raise UserError unless the same rows are fixed in both sets."""
    fixed_rows = [~motion.field.any(axis=1) & motion.known for motion in imported]
    other = np.flatnonzero((fixed_rows[0] != fixed_rows[1]) & imported[0].known & imported[1].known)
    if other.size:
        which, free = ("first", "second") if fixed_rows[0][other[0]] else ("second", "first")
        motion = describe_row(mesh, imported[0].constraint, int(other[0]))
        raise UserError(
            f"{motion} is fixed in the {which} result set, but not in the {free} result set (affected degrees of freedom: "
            f"{other.size})",
            key=KEY,
            remedy="compute both result sets with the same supports",
        )


def observe(
    mesh: Mesh, imported: ImportedMotion, results: Results, forces: Forces | None, names: tuple[str, ...], key: str
) -> Observed:
    """One set with the forces from the mass of our mesh, each motion scaled to unit energy:

        X U = [M Φ Λ, f]

    names: of all loads; key: of the set, for errors. Raises UserError if the mass of some nodes is unknown, and for
    modes and responses that `results_model` does not accept."""
    if not has_mass(mesh) or unresolved_rows(mesh, imported, mesh.nodes_of_elements).size:
        raise UserError(
            "two result sets require the mass of the mesh, but a region has no density, or the results lack the motion of a node",
            key=key,
            remedy="specify densities in mesh.materials, and write results of all nodes",
        )
    modes = normalise_results(mesh, imported, results, by_mesh=True)
    assert modes.weighed is not None
    notes, z, f = [*modes.notes], modes.response[:, :0], modes.response[:, :0]
    if forces is not None:
        z, f = modes.response, forces_on_rows(mesh, imported, forces)[:, results.load]
        notes += check_responses(modes, f, results, names) + describe_responses(names, results, 0, False, 0.0)
    scale = 1 / np.sqrt(np.concatenate([modes.lam, np.einsum("ij,ij->j", z, f)]))
    motion, force = np.hstack([modes.shape, z]) * scale, np.hstack([modes.weighed[0] * modes.lam, f]) * scale
    return Observed(motion, force, modes.lam, results.frequency, results.rounding, tuple(notes))


def asymmetry(observed_set: Observed) -> float:
    """Asymmetry of UᵀXU of unit diagonal, a bound of the accuracy of the forces; not zero for a lumped mass and for
    responses with few digits."""
    X = observed_set.motion.T @ observed_set.force
    return float(np.abs(X - X.T).max())


def check_frequencies(change: Change, first: Observed, second: Observed, stiff: bool) -> None:
    """Raise UserError unless λ₁/λ₀ of every mode is between 1 and θ₁/θ₀ (θ₀/θ₁ for a density), and not all are 1
    (Courant and Fischer)."""
    count, ratio = min(len(first.lam), len(second.lam)), change.second / change.first
    moved = second.lam[:count] / first.lam[:count]
    low, high = sorted((1.0, ratio if stiff else 1 / ratio))
    slack = 1e-6 + DIGITS * max(first.rounding, second.rounding)
    wrong = np.flatnonzero((moved < low * (1 - slack)) | (moved > high * (1 + slack)))
    name = change.parameter.name
    values = f"{name} from {change.first:g} to {change.second:g}"
    if wrong.size:
        i = int(wrong[0])
        raise UserError(
            f"mode {i + 1} changes from {first.frequency[i]:.6g} to {second.frequency[i]:.6g} Hz, but a change of {values} "
            f"allows only a factor of {np.sqrt(low):.4g} to {np.sqrt(high):.4g} between the frequencies",
            key=KEY,
            remedy="change only this parameter between the result sets, write the same number of modes from the lowest on, "
            "and check both values (mesh.results.at, mesh.results.second.at)",
        )
    if np.abs(moved - 1).max() < slack:
        raise UserError(
            f"both result sets have the same frequencies: the change of {values} affects none of {count} modes",
            key=KEY,
            remedy=f"specify the result file that was computed with {name} = {change.second:g} as mesh.results.second.file",
        )


POISSON = (0.0, 0.3)
"""Two Poisson's ratios; every isotropic stiffness is a combination of theirs."""
LEAST = 1e-8
"""Energy of a motion relative to the others, of unit energy, below which it is rounding error."""
OF_STRAIN = 100.0
"""Energy of a motion relative to the rounding errors of the files above which its strain is meaningful."""
FEW_DIGITS = 1e-6
"""Rounding error from which a file counts as one with few digits."""
APART = 1e-10
"""Energy of a motion in the region, relative to the largest, below which it is rounding error."""
FORM, NOTED = 0.1, 0.01
"""Share of the change that does not fit the stiffness of the region: limit for an error and for a note."""
REPRODUCED = 1e-3
"""Largest relative frequency error of the model."""
BEYOND = 0.1
"""Relative tolerance of the bounds on the stiffness of the region, because the sets are not exact."""


def build_two_set_model(
    mesh: Mesh,
    imported: tuple[ImportedMotion, ImportedMotion],
    results: tuple[Results, Results],
    forces: Forces | None,
    names: tuple[str, ...],
    scaled: Mapping[str, tuple[str, float]],
    change: Change,
) -> FullModel:
    """K and M of the coordinates (Φ₀, r₀, remainder of U₁), affine in the parameter of the change.

    Arguments as of `results_model`, for two sets; scaled: other parameters that scale the whole matrix. Raises
    UserError for sets that `results_model` does not accept; without a mass; for equal parameter values, different
    supports, impossible frequency changes, regions with elements other than isotropic solids, a change that does not
    fit the regions, and a model that does not reproduce the modes of both sets."""
    parameter = change.parameter
    if abs(change.second / change.first - 1) < 1e-6:
        raise UserError(
            f"both result sets have the same value {parameter.name} = {change.first:g}, so their difference does not "
            "show the effect of this parameter",
            key=f"{KEY}.at",
            remedy="compute the second result set with a value of the parameter that differs by 20 % to 50 %",
        )
    check_supports(mesh, imported)
    stiff = of_stiffness(parameter.property)
    meshes = [
        mesh if stiff else with_value(mesh, "density", parameter.regions, value)
        for value in (change.first, change.second)
    ]
    first, second = (
        observe(each, moved, results_of_set, forces, names, key)
        for each, moved, results_of_set, key in zip(meshes, imported, results, ("mesh.results", KEY), strict=True)
    )
    check_frequencies(change, first, second, stiff)
    U, k = np.hstack([first.motion, second.motion]), first.motion.shape[1]
    rows = imported[0].constraint.reference_rows
    M0 = U.T @ mass_product(meshes[0], rows, U)
    across = (first.force.T @ second.motion, first.motion.T @ second.force)
    A00, A11 = first.motion.T @ first.force, second.motion.T @ second.force
    notes: list[str] = []
    if stiff:
        D, notes = _change_of_stiffness(mesh, parameter, U, k, across[1] - across[0])
        A11 = A11 - D[k:, k:]
        X0, X1 = _assemble_blocks(A00, across[0], A11), D / (change.second - change.first)
    else:
        X0, X1 = M0, (U.T @ mass_product(meshes[1], rows, U) - M0) / (change.second - change.first)
        A = _assemble_blocks(A00, 0.5 * (across[0] + across[1]), A11)
    A = X0 if stiff else A
    rounding = max(first.rounding, second.rounding)
    exact = max(OF_STRAIN * rounding, asymmetry(first), asymmetry(second))
    C = _coordinates(A, len(first.lam), k, max(LEAST, exact))
    A, M0, X0, X1 = (_symmetrize(C.T @ X @ C) for X in (A, M0, X0, X1))
    if stiff:
        X1 = _clip_stiffness(X1, A, change.first)
    _check_reproduced(change, (first, second), A, M0, X1, stiff)
    affine = AffineOperator(sparse.csr_array(X0 - change.first * X1), {parameter.name: sparse.csr_array(X1)})
    stiffness = affine if stiff else as_operator(A, scaled.get("stiffness"))
    mass = as_operator(M0, scaled.get("mass")) if stiff else affine
    if rounding >= FEW_DIGITS:
        notes.append(
            f"the result files have a relative precision of {rounding:.0e}. The effect of {parameter.name} is the difference "
            f"of both result sets, so the relative error of σ({parameter.name}) can reach 1e-3. "
            "Binary files are more precise"
        )
    constraint = Constraint(as_sparse(U @ C), rows, np.zeros(0, dtype=np.int64))
    model = FiniteElementModel(mesh, constraint, stiffness, mass)
    return FullModel(model, notes=(*first.notes, *second.notes, *notes), modes=len(first.lam), alike=False)


def _change_of_stiffness(
    mesh: Mesh, parameter: Parameter, U: np.ndarray, k: int, N: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """D on U, with N = U₀ᵀDU₁ known, and a note on the share of N that does not fit the regions."""
    forms = [U.T @ _product(X, U) for X in _forms(mesh, parameter)]
    c = np.linalg.lstsq(np.stack([X[:k, k:].ravel() for X in forms], axis=1), N.ravel(), rcond=1e-10)[0]
    form = np.asarray(sum(value * X for value, X in zip(c, forms, strict=True)))
    S = N - form[:k, k:]
    misfit = float(np.linalg.norm(S) / np.linalg.norm(N))
    if misfit > FORM:
        raise UserError(
            f"{misfit:.0%} of the stiffness difference between the two result sets (limit {FORM:.0%}) does not fit isotropic "
            f"materials in {', '.join(str(mesh.regions[r]) for r in parameter.regions)}",
            key=KEY,
            remedy="change only this parameter in these regions; for anisotropic materials or other changes, "
            "import the input deck, or use mesh.matrices",
        )
    energy = _symmetrize(np.asarray(sum(forms)))
    a = _pseudo_inverse(energy[:k, :k]) @ energy[:k, k:]
    b = _pseudo_inverse(energy[k:, k:]) @ energy[k:, :k]
    D = _assemble_blocks(form[:k, :k] + _symmetrize(S @ b), N, form[k:, k:] + _symmetrize(a.T @ S))
    if misfit <= NOTED:
        return D, []
    return D, [
        f"{misfit:.1%} of the stiffness change due to {parameter.name} does not fit the element formulation of strainsight. "
        f"For values of {parameter.name} between those of the two result sets, the relative error of the frequencies is about "
        f"{misfit / 100:.0e}"
    ]


def _forms(mesh: Mesh, parameter: Parameter) -> list[sparse.csr_array]:
    """Stiffness (3n, 3n) [m] of the solids of each region, for unit modulus and both Poisson's ratios."""
    matrices = []
    for number in parameter.regions:
        solid = [block for block in mesh.blocks if np.any(block.region == number)]
        thin = any(np.any(block.region == number) for block in mesh.thin)
        other = thin or mesh.anisotropic_of(number) is not None or number in mesh.composites
        if not solid or other:
            raise UserError(
                f"{mesh.regions[number]} does not consist only of isotropic solids, so two result sets do not "
                "determine its stiffness",
                key=f"parameters.{parameter.name}.region",
                remedy="specify a region of isotropic solids, import the input deck, or use mesh.matrices",
            )
        blocks = tuple(
            replace(block, ids=block.ids[here], nodes=block.nodes[here], region=block.region[here])
            for block in solid
            for here in [block.region == number]
        )
        region = {number: Region(number, mesh.regions[number].name, 1)}
        part = Mesh(mesh.node_ids, mesh.position, blocks, regions=region)
        of_ratios = (replace(part, materials={1: Material(1, 1.0, ratio, 0.0)}) for ratio in POISSON)
        matrices += [assemble_stiffness(unit_mesh) for unit_mesh in of_ratios]
    return matrices


def _product(X: sparse.csr_array, U: np.ndarray) -> np.ndarray:
    """X U, zero in rows after the translations."""
    product = np.zeros_like(U)
    product[: X.shape[0]] = X @ U[: X.shape[0]]
    return product


def _pseudo_inverse(X: np.ndarray) -> np.ndarray:
    strength, V = np.linalg.eigh(X)
    significant = strength > APART * strength[-1]
    return np.asarray((V[:, significant] / strength[significant]) @ V[:, significant].T)


def _coordinates(A: np.ndarray, m: int, k: int, least: float) -> np.ndarray:
    """C (columns of U → coordinates): Φ₀ of unit mass, then the remainders of z₀ and of U₁, orthogonal in A with
    unit energy; remainders with an energy below `least` are dropped."""
    size = len(A)
    C = np.eye(size)[:, :m]
    for group in (slice(m, k), slice(k, size)):
        X = np.eye(size)[:, group]
        X = X - C @ np.linalg.solve(C.T @ A @ C, C.T @ A @ X)
        Y, energy = independent_directions(np.diag(np.diag(A)[group]), X.T @ A @ X, least)
        C = np.hstack([C, X @ Y / np.sqrt(energy)])
    return C


def _clip_stiffness(X1: np.ndarray, A: np.ndarray, first: float) -> np.ndarray:
    """Clip X1 to 0 ≤ θ₀X₁ ≤ A with tolerance `BEYOND`, since region and remaining structure have positive stiffness;
    K is then positive definite from θ₀/11 to 11 θ₀."""
    share, V = eigh(first * X1, A)
    return np.asarray(_symmetrize((A @ V * np.clip(share, -BEYOND, 1 + BEYOND)) @ (A @ V).T) / first)


def _check_reproduced(
    change: Change, sets: tuple[Observed, Observed], A: np.ndarray, M: np.ndarray, X1: np.ndarray, stiff: bool
) -> None:
    """Raise UserError unless the lowest modes at both values are those of the sets."""
    for which, observed_set in zip(("first", "second"), sets, strict=True):
        step = 0.0 if which == "first" else change.second - change.first
        K, mass = (A + step * X1, M) if stiff else (A, M + step * X1)
        frequency = np.sqrt(eigh(K, mass, eigvals_only=True)[: len(observed_set.lam)]) / (2 * np.pi)
        off = np.abs(frequency / observed_set.frequency - 1)
        worst = int(np.argmax(off))
        if not off[worst] < REPRODUCED:
            raise UserError(
                f"mode {worst + 1} of the {which} result set is at {frequency[worst]:.6g} Hz in the model interpolated "
                f"from both result sets, but at {observed_set.frequency[worst]:.6g} Hz in the file",
                key=KEY,
                remedy="use the mesh, densities and loads of the original analysis for both result sets, and all modes from "
                "the lowest on",
            )


def _assemble_blocks(X00: np.ndarray, X01: np.ndarray, X11: np.ndarray) -> np.ndarray:
    return np.block([[_symmetrize(X00), X01], [X01.T, _symmetrize(X11)]])


def _symmetrize(X: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (X + X.T))
