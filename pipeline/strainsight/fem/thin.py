"""Stiffness and mass of shells and beams on the translations and rotations of their nodes, affine in moduli and densities."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy import sparse

from strainsight.fem.affine import AffineOperator, Parameter, sum_of
from strainsight.fem.beam_curved import curved_beam_masses, curved_beam_stiffnesses
from strainsight.fem.beam_matrices import beam_masses, beam_stiffnesses, properties_of, rod_masses, rod_stiffnesses
from strainsight.fem.by_region import density_of, region_operator, regions_of
from strainsight.fem.shell_sections import resistance_of, shell_weight
from strainsight.fem.shells import shell_masses, shell_stiffnesses
from strainsight.mesh.model import Mesh
from strainsight.mesh.thin import BeamBlock, BeamSection, Section, ShellBlock, nodes_along_beams
from strainsight.parallel.threads import mapped

CHUNK = 2048
"""Elements at a time; of second-order shells fewer, so that they stay in the cache."""

Block = TypeVar("Block", ShellBlock, BeamBlock)


@dataclass(frozen=True)
class Pattern:
    """Pairs of nodes that share an element, sorted: onto (pairs, blocks of all elements) adds up what is of one pair; indptr
    (m + 1,) and columns (pairs,) say where each stands."""

    onto: sparse.csr_array
    indptr: np.ndarray
    columns: np.ndarray


def thin_operators(mesh: Mesh, parameters: Sequence[Parameter] = ()) -> tuple[AffineOperator, AffineOperator]:
    """Stiffness and consistent mass of shells and beams on six motions of each of their m nodes (6m, 6m), see `motions`:

        K(θ) = Σ_regions E_r K_r(ν_r, section),     M(θ) = Σ_regions ρ_r M_r(section) + M_nonstructural

    The terms of a parameter have unit modulus, factor or density; E_r is 1 of a laminate, whose K_r has the moduli of its
    plies, and ρ_r its mean density. K_r and M_r of moduli of plies and of factors of a section are those of `interpolated`.
    Raises DeckError for an element that is degenerate, UserError for parameters that overlap or name no region, or that a
    region has no property for.
    """
    found: dict[frozenset[int], Pattern] = {}

    def pattern(regions: Mapping[int, float]) -> Pattern:
        """Of the same regions at other values of their properties, and of their mass, it is the same."""
        key = frozenset(regions)
        if key not in found:
            found[key] = _pattern(mesh, _parts(mesh, regions))
        return found[key]

    K = region_operator(
        mesh, parameters, "stiffness", mesh.thin, lambda own, some: _sum(pattern(some), _stiffnesses(own, some))
    )
    M = region_operator(
        mesh, parameters, "mass", mesh.thin, lambda own, some: _sum(pattern(some), _masses(own, some, False))
    )
    beside = {number: 0.0 for number, own in mesh.sections.items() if _has_nonstructural(own)}
    more = AffineOperator(_sum(pattern(beside), _masses(mesh, beside, True)), {})
    return K, sum_of(M, more)


def motions(mesh: Mesh, rotation_rows: Mapping[int, int]) -> sparse.csr_array:
    """P (6m, 3n + 3r): three translations and three rotations of each node of shells and beams out of z, rotations of node i from
    row rotation_rows[i]. A node without rotations keeps those rows empty: what would resist them, as the torsion of rods
    between solids, is left out."""
    nodes = mesh.thin_nodes
    first = np.array([rotation_rows.get(node, -1) for node in nodes.tolist()], dtype=np.int64)
    columns = np.concatenate([3 * nodes[:, None] + np.arange(3), first[:, None] + np.arange(3)], axis=1).ravel()
    there = np.flatnonzero(np.repeat(np.stack([first >= -1, first >= 0], axis=1), 3))
    shape = (6 * len(nodes), 3 * len(mesh.position) + 3 * len(rotation_rows))
    size = np.int32 if max(shape) < 2**31 else np.int64  # or every product with it has column numbers of 8 bytes
    places = there.astype(size), columns[there].astype(size)
    return sparse.csr_array((np.ones(len(there)), places), shape=shape)


def thin_mass(mesh: Mesh, elements: np.ndarray | None = None) -> tuple[sparse.csr_array, list[int]]:
    """M (6m, 6m) of the shells and beams as they are, of these elements (ids) or all, and the regions that it is of."""
    own = mesh
    if elements is not None:
        own = replace(
            mesh,
            shells=tuple(_taken(block, np.isin(block.ids, elements)) for block in mesh.shells),
            beams=tuple(_taken(block, np.isin(block.ids, elements)) for block in mesh.beams),
        )
    regions = regions_of(own.thin)
    density = {number: density_of(mesh, number) for number in regions}
    return _sum(_pattern(mesh, _parts(own, density)), _masses(own, density, True)), regions


def _stiffnesses(mesh: Mesh, regions: Mapping[int, float]) -> list[np.ndarray]:
    """Factor × stiffness of the elements in these regions, some at a time, as `_blocks`."""
    along = nodes_along_beams(mesh.shells, mesh.beams)

    def of_part(part: ShellBlock | BeamBlock) -> np.ndarray:
        x = mesh.position[part.nodes]
        factor = np.array([regions[int(number)] for number in part.region])[:, None, None]
        if isinstance(part, ShellBlock):
            of = resistance_of(mesh, part)
            own = shell_stiffnesses(x, of.A, of.B, of.D, of.S, part.offset, part.ids, np.isin(part.nodes, along))
        else:
            nu = np.array([mesh.materials[mesh.regions[int(i)].material].poisson_ratio for i in part.region])
            properties = properties_of([_beam(mesh, int(number)) for number in part.region], nu)
            if part.kind == "rod":
                own = rod_stiffnesses(x, properties.area[:, 0], properties.torsion[:, 0], nu, part.ids)
            elif part.kind == "beam3":
                own = curved_beam_stiffnesses(x, part.axes, properties, part.offset, part.ids)
            else:
                own = beam_stiffnesses(x, part.axes, properties, part.offset, part.released, part.ids)
        return _blocks(part.nodes, factor * own)

    return mapped(of_part, _parts(mesh, regions))


def _masses(mesh: Mesh, density: Mapping[int, float], nonstructural: bool) -> list[np.ndarray]:
    """Mass of the elements in these regions, some at a time, as `_blocks`."""

    def of_part(part: ShellBlock | BeamBlock) -> np.ndarray:
        x = mesh.position[part.nodes]
        rho = np.array([density[int(number)] for number in part.region])
        if isinstance(part, ShellBlock):
            area, rotary, height = shell_weight(mesh, part, rho, nonstructural)
            own = shell_masses(x, area, rotary, height, part.ids)
        else:
            ends = [_ends(_beam(mesh, int(number))) for number in part.region]
            area, beside = (
                np.array([[getattr(end, name) for end in both] for both in ends]) for name in ("area", "nonstructural")
            )
            length, more = rho[:, None] * area, nonstructural * beside
            if part.kind == "rod":
                own = rod_masses(x, (length + more)[:, 0], part.ids)
            else:
                rotary = rho[:, None, None, None] * np.array([[end.second for end in both] for both in ends])
                places = np.array([[(end.neutral, end.beside) for end in both] for both in ends])
                if not places.any():
                    masses = curved_beam_masses if part.kind == "beam3" else beam_masses
                    own = masses(x, part.axes, length + more, part.offset, part.ids, rotary)
                else:
                    own = beam_masses(x, part.axes, length, part.offset, part.ids, rotary, places[:, :, 0])
                    own += beam_masses(x, part.axes, more, part.offset, part.ids, None, places[:, :, 1])
        return _blocks(part.nodes, own)

    return mapped(of_part, _parts(mesh, density))


def _blocks(nodes: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Matrices (e, 6k, 6k) of elements with nodes (e, k) by pairs of nodes (e k k, 36)."""
    e, k = nodes.shape
    return own.reshape(e, k, 6, k, 6).swapaxes(2, 3).reshape(-1, 36)


def _has_nonstructural(section: Section) -> bool:
    ends = _ends(section) if isinstance(section, BeamSection) else (section,)
    return any(own.nonstructural for own in ends)


def _beam(mesh: Mesh, region: int) -> BeamSection:
    section = mesh.sections[region]
    assert isinstance(section, BeamSection)
    return section


def _ends(section: BeamSection) -> tuple[BeamSection, BeamSection]:
    return section, section.at_b or section


def _parts(mesh: Mesh, regions: Mapping[int, float]) -> Iterator[ShellBlock | BeamBlock]:
    """The elements in these regions, some at a time."""
    for shells in mesh.shells:
        yield from _cut(shells, regions)
    for beams in mesh.beams:
        yield from _cut(beams, regions)


def _cut(block: Block, regions: Mapping[int, float]) -> Iterator[Block]:
    inside = np.flatnonzero(np.isin(block.region, list(regions)))
    size = CHUNK // 8 if block.nodes.shape[1] > 4 else CHUNK
    for start in range(0, len(inside), size):
        yield _taken(block, inside[start : start + size])


def _taken(block: Block, which: np.ndarray) -> Block:
    """Some elements of a block."""
    columns = {name: own for name, own in vars(block).items() if isinstance(own, np.ndarray)}
    return replace(block, **{name: own[which] for name, own in columns.items() if len(own) == len(block.ids)})


def _pattern(mesh: Mesh, parts: Iterator[ShellBlock | BeamBlock]) -> Pattern:
    """Of some elements, on all nodes of shells and beams of a mesh."""
    index = np.full(len(mesh.position), -1)
    index[mesh.thin_nodes] = np.arange(len(mesh.thin_nodes))
    m, keys = len(mesh.thin_nodes), [np.zeros(0, dtype=np.int64)]
    for part in parts:
        own = index[part.nodes]
        keys.append((own[:, :, None] * m + own[:, None, :]).ravel())
    pairs, place = np.unique(np.concatenate(keys), return_inverse=True)
    onto = sparse.csr_array((np.ones(len(place)), (place, np.arange(len(place)))), shape=(len(pairs), len(place)))
    indptr = (
        np.concatenate([[0], np.cumsum(np.bincount(pairs // m, minlength=m))]) if m else np.zeros(1, dtype=np.int64)
    )
    size: type[np.signedinteger] = np.int32 if 36 * len(pairs) < 2**31 else np.int64
    return Pattern(onto, indptr.astype(size), (pairs % m if m else pairs).astype(size))


def _sum(pattern: Pattern, parts: list[np.ndarray]) -> sparse.csr_array:
    """Σ over elements (6m, 6m): the 6 × 6 blocks of every pair of nodes, added up."""
    blocks = (pattern.onto @ np.concatenate([np.zeros((0, 36)), *parts])).reshape(-1, 6, 6)
    m = len(pattern.indptr) - 1
    X = sparse.bsr_array((blocks, pattern.columns, pattern.indptr), shape=(6 * m, 6 * m))
    return sparse.csr_array(X.tocsr())
