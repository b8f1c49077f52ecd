"""A sector of a structure that repeats itself about an axis, as the whole ring."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from strainsight.errors import UserError
from strainsight.mesh.anisotropic import Orientation
from strainsight.mesh.coordinates import BASIC, rotation
from strainsight.mesh.joins import AveragingElement, BodyForce, NodalForces, PointMass, Relation, RigidElement, Springs
from strainsight.mesh.model import FloatArray, IntArray, Mesh, Origin
from strainsight.mesh.unjoined import component_labels

NO_TURN = Orientation(BASIC, np.eye(3))
"""Of a material without an orientation: its axes are the basic ones."""


@dataclass(frozen=True)
class Copies:
    """A mesh and N turns (N, 3, 3) of it about a point of an axis, origin (3,); at (N, n): the node of the ring that each node is
    in each copy; kept (m,): which copy of which node, j n + i, each node of the ring is; shift: of ids from copy to copy."""

    mesh: Mesh
    turns: FloatArray
    origin: FloatArray
    at: IntArray
    kept: IntArray
    shift: int

    def made(self) -> Mesh:
        """The mesh of the ring."""
        mesh, n, count, shift = self.mesh, len(self.mesh.position), len(self.turns), self.shift
        copy, node = self.kept // n, self.kept % n
        position = self.origin + np.einsum("mij,mj->mi", self.turns[copy], mesh.position[node] - self.origin)
        position[copy == 0] = mesh.position[node[copy == 0]]
        axes = self._axes()
        ids = mesh.node_ids[node] + copy * shift
        turned = self._turned_regions()
        blocks = tuple(
            replace(
                block,
                ids=self._copied(block.ids),
                nodes=np.concatenate([self.at[j][block.nodes] for j in range(count)]),
                region=np.concatenate([block.region + j * shift * np.isin(block.region, turned) for j in range(count)]),
            )
            for block in mesh.blocks
        )
        node_sets = {name: self._node_set(own, ids) for name, own in mesh.node_sets.items()}
        element_sets = {name: np.sort(self._copied(own)) for name, own in mesh.element_sets.items()}
        named = [name for j in range(count) if (name := f"SECTOR-{j + 1}") in {*node_sets, *element_sets}]
        if named:
            raise UserError(
                f"the set {named[0]} is called as a copy of the sector will be", remedy="give it another name"
            )
        sector = np.sort(np.concatenate([block.ids for block in mesh.blocks]))
        for j in range(count):
            element_sets[f"SECTOR-{j + 1}"] = sector + j * shift
            node_sets[f"SECTOR-{j + 1}"] = np.unique(ids[self.at[j][mesh.nodes_of_elements]])
        fixed, held_axes = self._fixed(axes)
        axes |= held_axes
        rigid, averaging, ties = self._ties()
        relations, lines = self._relations(axes)
        made = replace(
            mesh,
            node_ids=ids,
            position=position,
            blocks=blocks,
            fixed=fixed,
            axes=axes,
            rigid=rigid,
            averaging=averaging,
            relations=relations,
            point_masses=tuple(self._masses()),
            springs=tuple(self._springs()),
            node_sets=node_sets,
            element_sets=element_sets,
            loads={name: self._load(load) for name, load in mesh.loads.items()},
            origin={
                **mesh.origin,
                "node": _lines(mesh.origin["node"], mesh.node_ids[node], ids),
                "element": _lines(
                    mesh.origin["element"],
                    np.concatenate([own.ids for own in mesh.blocks for _ in range(count)]),
                    np.concatenate([own.ids for own in blocks]),
                ),
                "tie": _lines(mesh.origin["tie"], ties, np.arange(1, len(ties) + 1)),
                "relation": _lines(mesh.origin["relation"], lines, np.arange(1, len(lines) + 1)),
            },
        )
        return self._with_regions(made, turned)

    def _copied(self, ids: IntArray) -> IntArray:
        """Ids in all copies."""
        return np.concatenate([ids + j * self.shift for j in range(len(self.turns))])

    def _node_set(self, own: IntArray, ids: IntArray) -> IntArray:
        rows = np.flatnonzero(np.isin(self.mesh.node_ids, own))
        return np.unique(ids[self.at[:, rows]])

    def _turned_regions(self) -> list[int]:
        """Regions whose material has axes that do not turn with the ring by themselves."""
        found = []
        for block in self.mesh.blocks:
            for number in np.unique(block.region).tolist():
                x = self.mesh.position[block.nodes[block.region == number]].mean(axis=1)
                R = self.turns[1]
                there = self.origin + (x - self.origin) @ R.T
                if number not in found and not all(
                    np.allclose(own.axes_at(there), R @ own.axes_at(x), atol=1e-9) for own in self._orientations(number)
                ):
                    found.append(number)
        return found

    def _orientations(self, region: int) -> list[Orientation]:
        """How the axes of its anisotropic materials lie, of a region of layers in each."""
        mesh = self.mesh
        if region in mesh.composites:
            layers = mesh.composites[region].layers
            return [own.orientation for own in layers if own.material in mesh.anisotropic]
        return [mesh.orientations.get(region, NO_TURN)] if mesh.anisotropic_of(region) is not None else []

    def _with_regions(self, mesh: Mesh, turned: Sequence[int]) -> Mesh:
        """The mesh with a region of its own in every copy for those of the numbers `turned`, its axes turned."""
        regions, orientations, composites = dict(mesh.regions), dict(mesh.orientations), dict(mesh.composites)
        for number in turned:
            for j in range(1, len(self.turns)):
                other = number + j * self.shift
                name = f"{mesh.regions[number].name} (sector {j + 1})"
                regions[other] = replace(mesh.regions[number], id=other, name=name)
                if number in composites:
                    layers = composites[number].layers
                    layers = tuple(replace(own, orientation=self._turned(own.orientation, j)) for own in layers)
                    composites[other] = replace(composites[number], layers=layers)
                else:
                    orientations[other] = self._turned(orientations.get(number, NO_TURN), j)
        return replace(mesh, regions=regions, orientations=orientations, composites=composites)

    def _turned(self, own: Orientation, j: int) -> Orientation:
        """As it is in copy j."""
        R, system = self.turns[j], own.system
        there = replace(system, origin=self.origin + R @ (system.origin - self.origin), axes=R @ system.axes)
        return replace(own, system=there)

    def _axes(self) -> dict[int, FloatArray]:
        """Displacement systems of the nodes that have one, or that a tie or relation speaks of along its own: turned."""
        mesh, n = self.mesh, len(self.mesh.position)
        spoken = {int(i) for own in mesh.relations for i in own.node}
        for tie in mesh.ties:
            spoken |= {tie.reference, *tie.nodes.tolist()}
        new_of = {int(own): row for row, own in enumerate(self.kept)}
        found = {}
        for node in sorted(spoken | {*mesh.axes}):
            for j in range(len(self.turns)):
                row = new_of.get(j * n + node)
                if row is not None and (j or node in mesh.axes):
                    found[row] = self.turns[j] @ mesh.axes.get(node, np.eye(3))
        return found

    def _fixed(self, axes: Mapping[int, FloatArray]) -> tuple[IntArray, dict[int, FloatArray]]:
        """Supports of all copies, and systems of nodes whose supports are along axes that turn with them."""
        mesh = self.mesh
        own_axes = {node: mesh.axes.get(node, np.eye(3)) for node in np.unique(mesh.fixed[:, 0]).tolist()}
        holds: dict[int, list[tuple[FloatArray, list[int]]]] = {}
        for node, A in own_axes.items():
            components = mesh.fixed[mesh.fixed[:, 0] == node, 1].tolist()
            for j, R in enumerate(self.turns):
                holds.setdefault(int(self.at[j, node]), []).append((R @ A, components))
        pairs: list[tuple[int, int]] = []
        systems: dict[int, FloatArray] = {}
        for row, own in holds.items():
            everything = np.hstack([A[:, [c for c in components if c < 3]] for A, components in own])
            rank = int(np.linalg.matrix_rank(everything, tol=1e-6)) if everything.size else 0
            turning = sorted({c for _, components in own for c in components if c > 2})
            if rank == 3 or not rank:
                pairs += [(row, c) for c in (*range(rank), *turning)]
                continue
            system = axes.get(row)
            chosen = _along(everything, rank, [system] if system is not None else [np.eye(3), *(A for A, _ in own)])
            if chosen is None:
                raise UserError(
                    f"supports of node {mesh.node_ids[self.kept[row] % len(mesh.position)]} and of the one that it meets in "
                    "the next sector hold other directions",
                    remedy="hold both cut faces alike, along a cylindrical system about the axis",
                )
            A, components = chosen
            if not np.array_equal(A, np.eye(3)):
                systems[row] = A
            pairs += [(row, c) for c in (*components, *turning)]
        return np.array(sorted(set(pairs)), dtype=np.int64).reshape(-1, 2), systems

    def _ties(self) -> tuple[tuple[RigidElement, ...], tuple[AveragingElement, ...], IntArray]:
        """Rigid and averaging elements of all copies, numbered together, and the number in the sector of each. Those of the
        copies whose reference is one node are one."""
        rigid: list[RigidElement] = []
        averaging: list[AveragingElement] = []
        number: list[int] = []
        for tie in self.mesh.rigid:
            for reference, group in self._by_reference(tie.reference):
                number.append(tie.id)
                nodes = np.unique(self.at[group][:, tie.nodes])
                rigid.append(replace(tie, id=len(number), reference=reference, nodes=nodes[nodes != reference]))
        for own in self.mesh.averaging:
            groups = self._by_reference(own.reference)
            if own.dependent is not None and len(groups) == 1:
                raise UserError(
                    f"{own}: an average about the axis whose equations are solved for other nodes is not made whole",
                    remedy="let it be solved for its reference",
                )
            for reference, group in groups:
                number.append(own.id)
                moved = own.with_nodes(reference, self.at[group][:, own.nodes].ravel(), self.at[group[0]])
                averaging.append(replace(moved, id=len(number)))
        return tuple(rigid), tuple(averaging), np.array(number, dtype=np.int64)

    def _by_reference(self, node: int) -> list[tuple[int, list[int]]]:
        """The nodes that a reference is in the ring, and the copies of each: one of all copies on the axis."""
        own, every = self.at[:, node].tolist(), list(range(len(self.turns)))
        return [(own[0], every)] if len(set(own)) == 1 else [(own[j], [j]) for j in every]

    def _relations(self, axes: Mapping[int, FloatArray]) -> tuple[tuple[Relation, ...], IntArray]:
        """Relations of all copies, and the number in the sector of each. Of a motion that is one with that of another copy the
        relation of that one counts; where it has none, UserError."""
        made: list[Relation] = []
        idle: dict[int, Relation] = {}
        number: list[int] = []
        n = len(self.mesh.position)
        for own in self.mesh.relations:
            for j, R in enumerate(self.turns):
                follower = int(self.at[j, own.node[0]])
                if self.kept[follower] != j * n + own.node[0]:
                    idle[follower] = own
                    continue
                terms: dict[tuple[int, int], float] = {}
                for node, component, value in zip(own.node.tolist(), own.component.tolist(), own.value, strict=True):
                    row, kind = int(self.at[j, node]), 3 * (component // 3)
                    direction = R @ self.mesh.axes.get(node, np.eye(3))[:, component % 3]
                    there = axes.get(row, np.eye(3)).T @ direction
                    for c in np.flatnonzero(abs(there) > 1e-12).tolist():
                        key = (row, kind + c)
                        terms[key] = terms.get(key, 0.0) + float(value * there[c])
                keys = list(terms)
                number.append(own.id)
                node, component = np.array(keys, dtype=np.int64).T
                made.append(
                    replace(
                        own, id=len(number), node=node, component=component, value=np.array([terms[k] for k in keys])
                    )
                )
        for row in set(idle) - {own.follower[0] for own in made}:
            raise UserError(
                f"{idle[row]}: node {self.mesh.node_ids[idle[row].node[0]]} is one with a node of the opposite cut face, which "
                "follows nothing",
                remedy="let the equation be solved for another motion, or write it for the node of the opposite face",
            )
        return tuple(made), np.array(number, dtype=np.int64)

    def _masses(self) -> Iterator[PointMass]:
        for own in self.mesh.point_masses:
            for j, R in enumerate(self.turns):
                both = np.kron(np.eye(2), R)
                yield replace(
                    own,
                    id=own.id + j * self.shift,
                    node=int(self.at[j, own.node]),
                    offset=R @ own.offset,
                    inertia=R @ own.inertia @ R.T,
                    matrix=None if own.matrix is None else both @ own.matrix @ both.T,
                )

    def _springs(self) -> Iterator[Springs]:
        for own in self.mesh.springs:
            for j, R in enumerate(self.turns):
                value = own.value[:, None] * R[:, own.component % 3].T
                component = 3 * (own.component // 3)[:, None] + np.arange(3)
                yield replace(
                    own,
                    spring=np.repeat(own.spring, 3),
                    node=np.repeat(self.at[j][own.node], 3),
                    component=component.ravel(),
                    value=value.ravel(),
                )

    def _load(self, load: NodalForces) -> NodalForces:
        force = [load.force @ R.T for R in self.turns]
        moment = None if load.moment is None else np.concatenate([load.moment @ R.T for R in self.turns])
        nodes = np.concatenate([own[load.nodes] for own in self.at])
        body = tuple(self._body(own) for own in load.body)
        return replace(load, nodes=nodes, force=np.concatenate(force), moment=moment, body=body)

    def _body(self, own: BodyForce) -> BodyForce:
        return own if own.elements is None else replace(own, elements=self._copied(own.elements))


def _along(held: FloatArray, rank: int, systems: Sequence[FloatArray]) -> tuple[FloatArray, list[int]] | None:
    """A system of the list along whose axes alone the span of `held` (3, k), of that rank, lies, and these axes."""
    u = np.linalg.svd(held)[0][:, :rank]
    for A in systems:
        within = np.linalg.norm(u.T @ A, axis=0)
        chosen = np.flatnonzero(within > 1 - 1e-9).tolist()
        if len(chosen) == rank:
            return A, chosen
    return None


def _lines(origin: Origin, old: IntArray, new: IntArray) -> Origin:
    """The lines of entities that are copies of others, by the ids of these."""
    order = np.argsort(origin.ids, kind="stable")
    row = order[np.searchsorted(origin.ids[order], old)] if len(old) else np.zeros(0, dtype=np.int64)
    return Origin(new, origin.line[row], origin.file[row], origin.files)


CLOSE = 1e-3
"""Of the shortest distance between nodes of a cut face: nodes of both that are this near after the turn are one."""
ON_AXIS = 1e-6
"""Of the largest radius: how far nodes of the axis may lie off it, as a deck of seven digits has them."""


@dataclass(frozen=True)
class Ring:
    """The whole of a sector: its mesh, and at (N, n): the node of every node of the sector in each copy; shift: what ids of one
    copy are above those of the one before; loose: of each pair of cut faces the nodes of the first one, in all copies, that no
    node of the second meets, and all nodes of the second."""

    mesh: Mesh
    at: IntArray
    shift: int
    loose: tuple[tuple[IntArray, IntArray], ...]


def whole_ring(
    mesh: Mesh, count: int, c: FloatArray, axis: FloatArray, cuts: Sequence[tuple[IntArray, IntArray]]
) -> Ring:
    """The ring of `count` copies of a mesh of solids, copy j turned by 2πj/count about the line through c (3,) along axis (3,):

        x_j = c + R_j (x − c)

    cuts: nodes (index) of one cut face of a part and of the opposite one, which meet in the next copy and become one; nodes on
    the axis are one in all copies. Copies carry everything that the sector has: elements, supports, ties, relations, masses,
    springs, material axes and loads, turned with them, and sets, which hold all copies; sets SECTOR-1, SECTOR-2, … have one
    each. Ids of copy j are those of the sector + j 10^k, and of the sector itself as they were.
    Raises UserError where a cut face does not meet the opposite one, where elements are shells or beams, where supports of two
    nodes that become one hold other directions, and where a relation is for a node that becomes one without any.
    """
    if mesh.thin:
        raise UserError(
            "a sector with shells or beams is not made a whole ring",
            remedy="mesh the whole structure, or its solids alone",
        )
    e = -axis / np.linalg.norm(axis)  # copy 1 lies clockwise of the sector, seen against the axis
    turns = np.array([rotation(e, 2 * np.pi * j / count) for j in range(count)])
    n = len(mesh.position)
    met: list[IntArray] = []  # pairs (k, 2) of nodes that are one; copy j of node i is j n + i
    follows = np.zeros(n, dtype=bool)
    loose: list[tuple[IntArray, IntArray]] = []
    rows = np.arange(count)[:, None] * n
    for first, second in cuts:
        pair, step, left = _meeting(mesh.position, first, second, c, e, count)
        follows[pair[:, 0]] = True
        met += [np.column_stack([j * n + pair[:, 0], (j + step) % count * n + pair[:, 1]]) for j in range(count)]
        loose.append(((rows + left).ravel(), (rows + second).ravel()))
    apart = mesh.position - c
    radius = np.linalg.norm(apart - np.outer(apart @ e, e), axis=1)
    on_axis = np.flatnonzero(radius <= ON_AXIS * max(radius.max(), 1e-300))
    met += [np.column_stack([j * n + on_axis, on_axis]) for j in range(1, count)]
    into = _as_one(np.concatenate(met), np.tile(follows, count))
    kept = np.flatnonzero(into == np.arange(count * n))
    new = np.zeros(count * n, dtype=np.int64)
    new[kept] = np.arange(len(kept))
    at = new[into].reshape(count, n)
    largest = max([int(mesh.node_ids.max()), *(int(block.ids.max()) for block in mesh.blocks)])
    shift = 10 ** len(str(largest))
    made = Copies(mesh, turns, c, at, kept, shift).made()
    return Ring(made, at, shift, tuple((np.unique(new[into[a]]), np.unique(new[into[b]])) for a, b in loose))


def _meeting(
    position: FloatArray, first: IntArray, second: IntArray, c: FloatArray, e: FloatArray, count: int
) -> tuple[IntArray, int, IntArray]:
    """Pairs (k, 2) of nodes of the first and the second cut face that are one where the second belongs to the copy `step` (±1)
    on, and the nodes of the first that meet none."""
    beside = np.asarray(cKDTree(position[second]).query(position[second], k=min(len(second), 2))[0])
    spacing = beside.reshape(len(second), -1)[:, -1]
    best: tuple[float, int, FloatArray, IntArray] | None = None
    for step in (1, -1):
        there = c + (position[second] - c) @ rotation(e, 2 * np.pi * step / count).T
        off, which = map(np.asarray, cKDTree(there).query(position[first]))
        if best is None or off.mean() < best[0]:
            best = (float(off.mean()), step, off, which)
    assert best is not None
    mean, step, off, which = best
    if mean > spacing.mean():
        raise UserError(
            f"the cut faces of the sector do not meet where one is turned by 360°/{count}: their nodes are {mean:.3g} apart",
            remedy="check the number of sectors, the axis, and the two surfaces",
        )
    near = off <= CLOSE * spacing.min()
    pair = np.column_stack([first[near], second[which[near]]])
    return pair, step, first[~near]


def _as_one(pairs: IntArray, follows: NDArray[np.bool_]) -> IntArray:
    """Each node's representative (k,) where the nodes of pairs (m, 2) are one: the first of them that does not follow, else the
    first."""
    k = len(follows)
    group = component_labels(k, *pairs.T)
    rank = np.arange(k) + k * follows
    least = np.full(k, 2 * k)
    np.minimum.at(least, group, rank)
    return np.asarray(least[group] % k)
