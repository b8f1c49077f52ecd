"""Expansion of a cyclic sector to the whole ring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from strainsight.errors import UserError
from strainsight.mesh.anisotropic import Orientation
from strainsight.mesh.coincident import component_labels
from strainsight.mesh.coordinates import BASIC, rotation
from strainsight.mesh.joins import AveragingElement, NodalForces, Relation, RigidElement
from strainsight.mesh.model import FloatArray, IntArray, Mesh, Origin

NO_TURN = Orientation(BASIC, np.eye(3))
"""Default orientation of a material: the basic axes."""


@dataclass(frozen=True)
class Copies:
    """A mesh and its N rotations (N, 3, 3) about a point of an axis, origin (3,).

    at (N, n): node of the ring for each node of each copy; kept (m,): copy and node, j n + i, of each node of the ring; shift:
    of ids from copy to copy."""

    mesh: Mesh
    turns: FloatArray
    origin: FloatArray
    at: IntArray
    unique_nodes: IntArray
    shift: int

    def build(self) -> Mesh:
        """The mesh of the ring."""
        mesh, n, count, shift = self.mesh, len(self.mesh.position), len(self.turns), self.shift
        copy, node = self.unique_nodes // n, self.unique_nodes % n
        position = self.origin + np.einsum("mij,mj->mi", self.turns[copy], mesh.position[node] - self.origin)
        position[copy == 0] = mesh.position[node[copy == 0]]
        axes = self._axes()
        ids = mesh.node_ids[node] + copy * shift
        turned = self._regions_to_rotate()
        blocks = tuple(
            replace(
                block,
                ids=self._ids_of_copies(block.ids),
                nodes=np.concatenate([self.at[j][block.nodes] for j in range(count)]),
                region=np.concatenate([block.region + j * shift * np.isin(block.region, turned) for j in range(count)]),
            )
            for block in mesh.blocks
        )
        node_sets = {
            name: np.unique(ids[self.at[:, np.isin(mesh.node_ids, members)]])
            for name, members in mesh.node_sets.items()
        }
        element_sets = {name: np.sort(self._ids_of_copies(members)) for name, members in mesh.element_sets.items()}
        named = [name for j in range(count) if (name := f"SECTOR-{j + 1}") in {*node_sets, *element_sets}]
        if named:
            raise UserError(
                f"the set name {named[0]} is reserved for a copy of the sector",
                remedy="Rename this node set or element set.",
            )
        sector = np.sort(np.concatenate([block.ids for block in mesh.blocks]))
        for j in range(count):
            element_sets[f"SECTOR-{j + 1}"] = sector + j * shift
            node_sets[f"SECTOR-{j + 1}"] = np.unique(ids[self.at[j][mesh.nodes_of_elements]])
        fixed, support_axes = self._fixed(axes)
        axes |= support_axes
        rigid, averaging, ties = self._ties()
        relations, lines = self._relations(axes)
        ring = replace(
            mesh,
            node_ids=ids,
            position=position,
            blocks=blocks,
            fixed=fixed,
            axes=axes,
            rigid=rigid,
            averaging=averaging,
            relations=relations,
            point_masses=tuple(
                replace(mass.rotated(R), id=mass.id + j * shift, node=int(self.at[j, mass.node]))
                for mass in mesh.point_masses
                for j, R in enumerate(self.turns)
            ),
            springs=tuple(
                replace(springs, node=self.at[j][springs.node]).rotated(R)
                for springs in mesh.springs
                for j, R in enumerate(self.turns)
            ),
            node_sets=node_sets,
            element_sets=element_sets,
            loads={name: self._load(load) for name, load in mesh.loads.items()},
            origin={
                **mesh.origin,
                "node": _lines(mesh.origin["node"], mesh.node_ids[node], ids),
                "element": _lines(
                    mesh.origin["element"],
                    np.concatenate([members.ids for members in mesh.blocks for _ in range(count)]),
                    np.concatenate([members.ids for members in blocks]),
                ),
                "tie": _lines(mesh.origin["tie"], ties, np.arange(1, len(ties) + 1)),
                "relation": _lines(mesh.origin["relation"], lines, np.arange(1, len(lines) + 1)),
            },
        )
        return self._with_regions(ring, turned)

    def _ids_of_copies(self, ids: IntArray) -> IntArray:
        """Ids in all copies."""
        return np.concatenate([ids + j * self.shift for j in range(len(self.turns))])

    def _regions_to_rotate(self) -> list[int]:
        """Regions whose material axes differ between the copies."""
        regions = []
        for block in self.mesh.blocks:
            for number in np.unique(block.region).tolist():
                x = self.mesh.position[block.nodes[block.region == number]].mean(axis=1)
                R = self.turns[1]
                rotated = self.origin + (x - self.origin) @ R.T
                if number not in regions and not all(
                    np.allclose(orientation.axes_at(rotated), R @ orientation.axes_at(x), atol=1e-9)
                    for orientation in self._orientations(number)
                ):
                    regions.append(number)
        return regions

    def _orientations(self, region: int) -> list[Orientation]:
        """Orientations of the anisotropic materials of a region, for a composite solid of each layer."""
        mesh = self.mesh
        if region in mesh.composites:
            layers = mesh.composites[region].layers
            return [layer.orientation for layer in layers if layer.material in mesh.anisotropic]
        return [mesh.orientations.get(region, NO_TURN)] if mesh.anisotropic_of(region) is not None else []

    def _with_regions(self, mesh: Mesh, turned: Sequence[int]) -> Mesh:
        """The mesh with a separate region in every copy for the regions `turned`, with rotated material axes."""
        regions, orientations, composites = dict(mesh.regions), dict(mesh.orientations), dict(mesh.composites)
        for number in turned:
            for j in range(1, len(self.turns)):
                other = number + j * self.shift
                name = f"{mesh.regions[number].name} (sector {j + 1})"
                regions[other] = replace(mesh.regions[number], id=other, name=name)
                if number in composites:
                    layers = composites[number].layers
                    layers = tuple(
                        replace(layer, orientation=self._rotate_orientation(layer.orientation, j)) for layer in layers
                    )
                    composites[other] = replace(composites[number], layers=layers)
                else:
                    orientations[other] = self._rotate_orientation(orientations.get(number, NO_TURN), j)
        return replace(mesh, regions=regions, orientations=orientations, composites=composites)

    def _rotate_orientation(self, orientation: Orientation, j: int) -> Orientation:
        """The orientation in copy j."""
        R, system = self.turns[j], orientation.system
        rotated = replace(system, origin=self.origin + R @ (system.origin - self.origin), axes=R @ system.axes)
        return replace(orientation, system=rotated)

    def _axes(self) -> dict[int, FloatArray]:
        """Local axes of the nodes that have them, or that a tie or relation refers to, rotated with the copies."""
        mesh, n = self.mesh, len(self.mesh.position)
        named = {int(i) for relation in mesh.relations for i in relation.node}
        for tie in mesh.ties:
            named |= {tie.reference, *tie.nodes.tolist()}
        new_of = {int(relation): row for row, relation in enumerate(self.unique_nodes)}
        axes = {}
        for node in sorted(named | {*mesh.axes}):
            for j in range(len(self.turns)):
                row = new_of.get(j * n + node)
                if row is not None and (j or node in mesh.axes):
                    axes[row] = self.turns[j] @ mesh.axes.get(node, np.eye(3))
        return axes

    def _fixed(self, axes: Mapping[int, FloatArray]) -> tuple[IntArray, dict[int, FloatArray]]:
        """Supports of all copies, and local axes of nodes whose supports rotate with the copies."""
        mesh = self.mesh
        node_axes = {node: mesh.axes.get(node, np.eye(3)) for node in np.unique(mesh.fixed[:, 0]).tolist()}
        holds: dict[int, list[tuple[FloatArray, list[int]]]] = {}
        for node, A in node_axes.items():
            components = mesh.fixed[mesh.fixed[:, 0] == node, 1].tolist()
            for j, R in enumerate(self.turns):
                holds.setdefault(int(self.at[j, node]), []).append((R @ A, components))
        pairs: list[tuple[int, int]] = []
        systems: dict[int, FloatArray] = {}
        for row, systems_and_components in holds.items():
            everything = np.hstack([A[:, [c for c in components if c < 3]] for A, components in systems_and_components])
            rank = int(np.linalg.matrix_rank(everything, tol=1e-6)) if everything.size else 0
            turning = sorted({c for _, components in systems_and_components for c in components if c > 2})
            if rank == 3 or not rank:
                pairs += [(row, c) for c in (*range(rank), *turning)]
                continue
            candidates = [axes[row]] if row in axes else [np.eye(3), *(A for A, _ in systems_and_components)]
            if (chosen := _along(everything, rank, candidates)) is None:
                raise UserError(
                    f"the supports of node {mesh.node_ids[self.unique_nodes[row] % len(mesh.position)]} and of the "
                    "coincident node in the next sector act in different directions",
                    remedy="Apply the same supports to both sector faces, in a cylindrical coordinate system about the "
                    "sector axis.",
                )
            A, components = chosen
            if not np.array_equal(A, np.eye(3)):
                systems[row] = A
            pairs += [(row, c) for c in (*components, *turning)]
        return np.array(sorted(set(pairs)), dtype=np.int64).reshape(-1, 2), systems

    def _ties(self) -> tuple[tuple[RigidElement, ...], tuple[AveragingElement, ...], IntArray]:
        """Rigid and averaging elements of all copies, numbered together, and the number of each in the sector. Copies with
        the same reference node are merged."""
        rigid: list[RigidElement] = []
        averaging: list[AveragingElement] = []
        number: list[int] = []
        for tie in self.mesh.rigid:
            for reference, group in self._by_reference(tie.reference):
                number.append(tie.id)
                nodes = np.unique(self.at[group][:, tie.nodes])
                rigid.append(replace(tie, id=len(number), reference=reference, nodes=nodes[nodes != reference]))
        for average in self.mesh.averaging:
            groups = self._by_reference(average.reference)
            if average.dependent is not None and len(groups) == 1:
                raise UserError(
                    f"{average}: an averaging element (RBE3) with UM components and its reference node on the sector axis "
                    "cannot be copied to other sectors",
                    remedy="Remove UM: the reference node is then the dependent node.",
                )
            for reference, group in groups:
                number.append(average.id)
                copy = average.with_nodes(reference, self.at[group][:, average.nodes].ravel(), self.at[group[0]])
                averaging.append(replace(copy, id=len(number)))
        return tuple(rigid), tuple(averaging), np.array(number, dtype=np.int64)

    def _by_reference(self, node: int) -> list[tuple[int, list[int]]]:
        """Nodes of a reference in the ring, and the copies of each: all copies of a reference on the axis are merged."""
        references, every = self.at[:, node].tolist(), list(range(len(self.turns)))
        return [(references[0], every)] if len(set(references)) == 1 else [(references[j], [j]) for j in every]

    def _relations(self, axes: Mapping[int, FloatArray]) -> tuple[tuple[Relation, ...], IntArray]:
        """Relations of all copies, and the number of each in the sector. If the dependent motion coincides with that of another
        copy, the relation of that copy counts; UserError if it has no relation."""
        relations: list[Relation] = []
        replaced: dict[int, Relation] = {}
        number: list[int] = []
        n = len(self.mesh.position)
        for relation in self.mesh.relations:
            for j, R in enumerate(self.turns):
                follower = int(self.at[j, relation.node[0]])
                if self.unique_nodes[follower] != j * n + relation.node[0]:
                    replaced[follower] = relation
                    continue
                terms: dict[tuple[int, int], float] = {}
                for node, component, value in zip(
                    relation.node.tolist(), relation.component.tolist(), relation.value, strict=True
                ):
                    row, kind = int(self.at[j, node]), 3 * (component // 3)
                    direction = R @ self.mesh.axes.get(node, np.eye(3))[:, component % 3]
                    components = axes.get(row, np.eye(3)).T @ direction
                    for c in np.flatnonzero(abs(components) > 1e-12).tolist():
                        key = (row, kind + c)
                        terms[key] = terms.get(key, 0.0) + float(value * components[c])
                number.append(relation.id)
                node, component = np.array(list(terms), dtype=np.int64).T
                value = np.array(list(terms.values()))
                relations.append(replace(relation, id=len(number), node=node, component=component, value=value))
        for row in set(replaced) - {relation.follower[0] for relation in relations}:
            raise UserError(
                f"{replaced[row]}: the dependent node {self.mesh.node_ids[replaced[row].node[0]]} of this constraint equation is "
                "on a cut face of the sector, but the opposite node of the other cut face has no such equation",
                remedy="Define the equation on the opposite face too, or begin it with a node inside the sector.",
            )
        return tuple(relations), np.array(number, dtype=np.int64)

    def _load(self, load: NodalForces) -> NodalForces:
        force = [load.force @ R.T for R in self.turns]
        moment = None if load.moment is None else np.concatenate([load.moment @ R.T for R in self.turns])
        nodes = np.concatenate([rows[load.nodes] for rows in self.at])
        body = tuple(
            part if part.elements is None else replace(part, elements=self._ids_of_copies(part.elements))
            for part in load.body
        )
        return replace(load, nodes=nodes, force=np.concatenate(force), moment=moment, body=body)


def _along(directions: FloatArray, rank: int, systems: Sequence[FloatArray]) -> tuple[FloatArray, list[int]] | None:
    """A system of the list with axes that span the column space of `directions` (3, k) of that rank, and these axes."""
    u = np.linalg.svd(directions)[0][:, :rank]
    for A in systems:
        chosen = np.flatnonzero(np.linalg.norm(u.T @ A, axis=0) > 1 - 1e-9).tolist()
        if len(chosen) == rank:
            return A, chosen
    return None


def _lines(origin: Origin, old: IntArray, new: IntArray) -> Origin:
    """The lines of copied entities, from the ids of the originals."""
    order = np.argsort(origin.ids, kind="stable")
    row = order[np.searchsorted(origin.ids[order], old)] if len(old) else np.zeros(0, dtype=np.int64)
    return Origin(new, origin.line[row], origin.file[row], origin.files)


CLOSE = 1e-3
"""Largest distance of coincident nodes of rotated cut faces, as a share of the smallest node distance on a cut face."""
ON_AXIS = 1e-6
"""Largest distance from the axis of nodes on it, as a share of the largest radius; covers decks with seven digits."""


@dataclass(frozen=True)
class Ring:
    """The expanded ring: its mesh, and at (N, n): the node of the ring for every node of each copy; shift: difference of ids
    between copies; loose: for each pair of cut faces the nodes of the first one, in all copies, without a coincident node, and
    all nodes of the second."""

    mesh: Mesh
    at: IntArray
    shift: int
    loose: tuple[tuple[IntArray, IntArray], ...]


def whole_ring(
    mesh: Mesh, count: int, c: FloatArray, axis: FloatArray, cuts: Sequence[tuple[IntArray, IntArray]]
) -> Ring:
    """The ring of `count` copies of a mesh of solids, copy j rotated by 2πj/count about the line through c (3,) along axis (3,):

        x_j = c + R_j (x − c)

    cuts: nodes (index) of one cut face of a part and of the opposite one, which coincide in the next copy and are merged; nodes
    on the axis are merged in all copies. Copies include elements, supports, ties, relations, masses, springs, material axes
    and loads, rotated, and sets, which contain all copies; sets SECTOR-1, SECTOR-2, … contain one copy each. Ids of copy j are
    those of the sector + j 10^k; those of the sector are unchanged.
    Raises UserError if the cut faces do not match, for shells or beams, if supports of two merged nodes act in different
    directions, and if a relation applies to a merged node without one."""
    if mesh.thin:
        raise UserError(
            "a sector with shells or beams cannot be expanded to the whole structure",
            remedy="Mesh the whole structure, or use solids only.",
        )
    e = -axis / np.linalg.norm(axis)  # copy 1 lies clockwise of the sector when looking against the axis
    turns = np.array([rotation(e, 2 * np.pi * j / count) for j in range(count)])
    n = len(mesh.position)
    pairs_of_nodes: list[IntArray] = []  # merged pairs (k, 2); copy j of node i is j n + i
    follows = np.zeros(n, dtype=bool)
    loose: list[tuple[IntArray, IntArray]] = []
    rows = np.arange(count)[:, None] * n
    for first, second in cuts:
        pair, step, left = _match_faces(mesh.position, first, second, c, e, count)
        follows[pair[:, 0]] = True
        pairs_of_nodes += [
            np.column_stack([j * n + pair[:, 0], (j + step) % count * n + pair[:, 1]]) for j in range(count)
        ]
        loose.append(((rows + left).ravel(), (rows + second).ravel()))
    arm = mesh.position - c
    radius = np.linalg.norm(arm - np.outer(arm @ e, e), axis=1)
    on_axis = np.flatnonzero(radius <= ON_AXIS * max(radius.max(), 1e-300))
    pairs_of_nodes += [np.column_stack([j * n + on_axis, on_axis]) for j in range(1, count)]
    into = _representatives(np.concatenate(pairs_of_nodes), np.tile(follows, count))
    unique_nodes = np.flatnonzero(into == np.arange(count * n))
    new = np.zeros(count * n, dtype=np.int64)
    new[unique_nodes] = np.arange(len(unique_nodes))
    at = new[into].reshape(count, n)
    shift = 10 ** len(str(max(int(ids.max()) for ids in (mesh.node_ids, *(block.ids for block in mesh.blocks)))))
    ring = Copies(mesh, turns, c, at, unique_nodes, shift).build()
    return Ring(ring, at, shift, tuple((np.unique(new[into[a]]), np.unique(new[into[b]])) for a, b in loose))


def _match_faces(
    position: FloatArray, first: IntArray, second: IntArray, c: FloatArray, e: FloatArray, count: int
) -> tuple[IntArray, int, IntArray]:
    """Pairs (k, 2) of coincident nodes of the first cut face and of the second in the copy `step` (±1), and the unmatched nodes
    of the first."""
    neighbours = np.asarray(cKDTree(position[second]).query(position[second], k=min(len(second), 2))[0])
    spacing = neighbours.reshape(len(second), -1)[:, -1]
    matches = []
    for step in (1, -1):
        rotated = c + (position[second] - c) @ rotation(e, 2 * np.pi * step / count).T
        off, which = map(np.asarray, cKDTree(rotated).query(position[first]))
        matches.append((float(off.mean()), step, off, which))
    mean, step, off, which = min(matches, key=lambda match: match[0])
    if mean > spacing.mean():
        raise UserError(
            f"the cut faces of the sector do not match after a rotation by 360°/{count}: the mean distance of opposite nodes is "
            f"{mean:.3g} m (limit: mean node spacing {spacing.mean():.3g} m)",
            remedy="Check the number of sectors, the axis and the meshes of the two cut faces.",
        )
    near = off <= CLOSE * spacing.min()
    return np.column_stack([first[near], second[which[near]]]), step, first[~near]


def _representatives(pairs: IntArray, follows: NDArray[np.bool_]) -> IntArray:
    """Representative (k,) of each node if the nodes of pairs (m, 2) are merged: the first one that does not follow, otherwise
    the first."""
    k = len(follows)
    group = component_labels(k, *pairs.T)
    rank = np.arange(k) + k * follows
    least = np.full(k, 2 * k)
    np.minimum.at(least, group, rank)
    return np.asarray(least[group] % k)
