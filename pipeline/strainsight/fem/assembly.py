"""Stiffness and mass, affine in the moduli and densities of the regions (5.8-5.10)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import sparse

from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.by_region import by_element, cut, poisson_ratios, region_operator, some_of, targets
from strainsight.fem.checks import check_mesh
from strainsight.fem.elasticity import (
    anisotropic_regions,
    anisotropic_stiffnesses,
    by_rule,
    elasticities,
    element_stiffnesses,
    relative_masses,
)
from strainsight.memory import require_memory
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import CellBlock, Mesh

CHUNK = 2048
PAIR_BYTES = 9 * 8 + 8 + 1
"""Bytes of a node pair of an element during assembly: its block, its place, and its orientation."""


@dataclass(frozen=True)
class Pattern:
    """Node pairs (row ≤ column) that share an element, sorted; place: pair of an element → node pair; flipped: the pair
    has row > column in the element."""

    row: np.ndarray
    column: np.ndarray
    place: np.ndarray
    flipped: np.ndarray


def assemble(mesh: Mesh, parameters: Sequence[Parameter] = ()) -> tuple[AffineOperator, AffineOperator]:
    """Stiffness and consistent mass of the solids, clamped nodes included:

        K(θ) = Σ_regions E_r ∫ BᵀD(ν_r)B dV,     M(θ) = Σ_regions ρ_r ∫ NᵀN dV ⊗ I₃

    D(ν) is isotropic elasticity with unit modulus. For an anisotropic material E D is C along the basic axes, for a
    composite solid that of the layer at the point of integration; the same holds for ρ. The terms of a modulus or density
    have unit modulus [m] or unit density [m³]; the term of a stiffness factor is the stiffness itself [N/m]. Everything
    else is in the constant part [N/m, kg]. Moduli of isotropic layers of a composite solid are treated as those of plies
    in `thin_operators`; other properties of plies and sections do not apply to solids.
    Returns (stiffness, mass), CSR (3n, 3n), row 3·node + component.
    Raises DeckError for an inverted element (ids named), a region or material that is missing or not physical,
    and UserError for parameters that overlap or name no region, or where the memory is insufficient."""
    check_mesh(mesh)
    pairs = sum(len(block.ids) * block.nodes.shape[1] * (block.nodes.shape[1] + 1) // 2 for block in mesh.blocks)
    require_memory(PAIR_BYTES * pairs, f"the stiffness matrix of a mesh with {len(mesh.position)} nodes")

    @cache
    def pattern(regions: frozenset[int]) -> Pattern:
        """Stiffness and mass of the same regions share their node pairs."""
        return _pattern(mesh, regions)

    def of(kind: str, sums: Callable[[Mesh, Mapping[int, float], Pattern], sparse.csr_array]) -> AffineOperator:
        def sum_regions(part_mesh: Mesh, some: Mapping[int, float]) -> sparse.csr_array:
            empty = sparse.csr_array((3 * len(mesh.position),) * 2)
            return sums(part_mesh, some, pattern(frozenset(some))) if some else empty

        operator = region_operator(mesh, parameters, kind, mesh.blocks, sum_regions)
        # terms of shells have the same labels, with a dependence that differs where it is not proportional
        label = {term: f"solids: {term}" if term in operator.coefficients else term for term in operator.terms}
        return AffineOperator(
            operator.constant,
            {label[term_label]: term for term_label, term in operator.terms.items()},
            {label[term_label]: coefficient for term_label, coefficient in operator.coefficients.items()},
        )

    return of("stiffness", _stiffness), of("mass", _mass)


def assemble_stiffness(mesh: Mesh) -> sparse.csr_array:
    """K (3n, 3n) [N/m] of `assemble` alone, of the moduli that the mesh has. Raises what `assemble` does."""
    check_mesh(mesh)
    regions = targets(mesh, (), "stiffness")[""]
    return _stiffness(mesh, regions, _pattern(mesh, regions))


def chunks(mesh: Mesh, regions: Collection[int], size: int | None = CHUNK) -> Iterator[CellBlock]:
    """The elements in these regions, a few at a time."""
    for block in mesh.blocks:
        yield from cut(block, regions, size)


def _pattern(mesh: Mesh, regions: Collection[int]) -> Pattern:
    """Node pairs of every element in these regions, each unordered pair once (a ≤ b locally)."""
    nodes = len(mesh.position)
    keys, flips = [], []
    for part in chunks(mesh, regions, None):
        a, b = np.triu_indices(part.nodes.shape[1])
        first, second = part.nodes[:, a].ravel(), part.nodes[:, b].ravel()
        flips.append(first > second)
        keys.append(np.minimum(first, second) * np.int64(nodes) + np.maximum(first, second))
    pairs, place = np.unique(np.concatenate(keys), return_inverse=True)
    return Pattern(pairs // nodes, pairs % nodes, place, np.concatenate(flips))


def _stiffness(mesh: Mesh, regions: Mapping[int, float], pattern: Pattern) -> sparse.csr_array:
    anisotropic = anisotropic_regions(mesh)

    def kernel(position: np.ndarray, part: CellBlock) -> np.ndarray:
        if not (is_anisotropic := np.isin(part.region, anisotropic)).any():
            return _isotropic(mesh, part, position)
        K = np.empty((len(part.ids), position.shape[1] * (position.shape[1] + 1) // 2, 9))
        K[is_anisotropic] = _anisotropic(mesh, some_of(part, is_anisotropic), position[is_anisotropic])
        if not is_anisotropic.all():
            K[~is_anisotropic] = _isotropic(mesh, some_of(part, ~is_anisotropic), position[~is_anisotropic])
        return K

    indptr, columns, source, transposed = _full_pattern(len(mesh.position), pattern)
    data = _accumulate(mesh, regions, pattern, kernel, 9).reshape(-1, 3, 3)[source]
    data[transposed] = data[transposed].swapaxes(1, 2)
    return sparse.bsr_array((data, columns, indptr), shape=(3 * len(mesh.position),) * 2).tocsr()


def _isotropic(mesh: Mesh, part: CellBlock, position: np.ndarray) -> np.ndarray:
    nu = poisson_ratios(mesh, part.region)
    return element_stiffnesses(kind_of(part.kind), position, nu, part.ids)


def _anisotropic(mesh: Mesh, part: CellBlock, position: np.ndarray) -> np.ndarray:
    kind = kind_of(part.kind)
    K = np.empty((len(part.ids), position.shape[1] * (position.shape[1] + 1) // 2, 9))
    for elements, rule in by_rule(mesh, kind, part.region):
        C = elasticities(mesh, kind, position[elements], part.region[elements], rule[0])
        K[elements] = anisotropic_stiffnesses(kind, position[elements], C, part.ids[elements], rule)
    return K


def _mass(mesh: Mesh, regions: Mapping[int, float], pattern: Pattern) -> sparse.csr_array:
    def kernel(position: np.ndarray, part: CellBlock) -> np.ndarray:
        return relative_masses(mesh, part, kind_of(part.kind))[:, :, None]

    values, nodes = _accumulate(mesh, regions, pattern, kernel, 1)[:, 0], len(mesh.position)
    indptr, columns, source, _ = _full_pattern(nodes, pattern)
    return expand(sparse.csr_array((values[source], columns, indptr), shape=(nodes, nodes)))


def _accumulate(
    mesh: Mesh,
    regions: Mapping[int, float],
    pattern: Pattern,
    kernel: Callable[[np.ndarray, CellBlock], np.ndarray],
    width: int,
) -> np.ndarray:
    """Σ over elements of factor × kernel (e, pairs, width) into the node pairs (p, width)."""
    local = np.empty((len(pattern.place), width))
    at = 0
    for part in chunks(mesh, regions):
        values = kernel(mesh.position[part.nodes], part) * by_element(part, regions)[:, None, None]
        local[at : at + values.shape[0] * values.shape[1]] = values.reshape(-1, width)
        at += values.shape[0] * values.shape[1]
    if width == 9:
        flipped = np.flatnonzero(pattern.flipped)
        local[flipped] = local[flipped].reshape(-1, 3, 3).swapaxes(1, 2).reshape(-1, 9)
    pairs = len(pattern.row)
    return np.stack([np.bincount(pattern.place, local[:, c], pairs) for c in range(width)], axis=1)


def _full_pattern(nodes: int, pattern: Pattern) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Both triangles in CSR order: indptr, columns, the pair each entry comes from, and whether it is transposed."""
    pairs = len(pattern.row)
    below = np.flatnonzero(pattern.row != pattern.column)
    rows = np.concatenate([pattern.column[below], pattern.row])
    # a stable sort by row, lower triangle first, leaves the columns of each row ascending
    order = np.argsort(rows, kind="stable")
    columns = np.concatenate([pattern.row[below], pattern.column])[order]
    source = np.concatenate([below, np.arange(pairs)])[order]
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=nodes))])
    # half the memory of the column numbers of K: 9 entries a pair
    index = np.int32 if 9 * len(columns) < 2**31 else np.int64
    return indptr.astype(index), columns.astype(index), source, order < len(below)


def expand(m: sparse.csr_array) -> sparse.csr_array:
    """m ⊗ I₃, rows 3·node + component: m (n, n) → (3n, 3n)."""
    size = 3 * m.shape[0]
    index: type[np.signedinteger] = np.int32 if max(size, 3 * m.nnz) < 2**31 else np.int64
    per_row = np.repeat(np.diff(m.indptr), 3)
    indptr = np.concatenate([[0], np.cumsum(per_row)]).astype(index)
    entry = np.arange(indptr[-1], dtype=index)
    entry += np.repeat(np.subtract(np.repeat(m.indptr[:-1], 3), indptr[:-1], dtype=index), per_row)
    data = m.data[entry]
    columns = m.indices.astype(index)[entry]
    del entry
    columns *= 3
    columns += np.repeat(np.tile(np.arange(3, dtype=index), m.shape[0]), per_row)
    return sparse.csr_array((data, columns, indptr), shape=(size, size))
