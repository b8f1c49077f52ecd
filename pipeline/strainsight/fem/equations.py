"""Motions of nodes as rows, and equations of those that follow others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError
from strainsight.mesh.joins import AveragingElement, Relation, RigidElement
from strainsight.mesh.model import Mesh

ROUNDING = 1e-13
"""Of the coefficients of an equation: one below it, over the largest, is rounding."""

Tie = RigidElement | AveragingElement | Relation


def entity_of(e: Tie) -> tuple[str, int]:
    """What an error about a tie names, for `Mesh.where`."""
    return ("relation" if isinstance(e, Relation) else "tie", e.id)


@dataclass(frozen=True)
class Rows:
    """Where motions stand in z': 3·node + component, then three rotations of each node that has them.

    nodes n; first: node → row of its first rotation; axes: node → (3, 3) axes of its components, one in a column, the
    basic ones where it has none.
    """

    nodes: int
    first: Mapping[int, int]
    axes: Mapping[int, np.ndarray]

    @property
    def size(self) -> int:
        """3n + 3r."""
        return 3 * self.nodes + 3 * len(self.first)

    def of(self, nodes: np.ndarray, components: np.ndarray | int) -> np.ndarray:
        """Rows of components 0-5 of nodes (k,); −1 for a rotation of a node that has none."""
        nodes, components = np.broadcast_arrays(np.asarray(nodes, dtype=np.int64), components)
        rows = 3 * nodes + components
        turning = components > 2
        rows[turning] = [
            self.first[node] + c - 3 if node in self.first else -1
            for node, c in zip(nodes[turning].tolist(), components[turning].tolist(), strict=True)
        ]
        return rows

    def translations(self, nodes: np.ndarray | list[int]) -> np.ndarray:
        """Rows (3k,) of the translations of nodes (k,)."""
        return (3 * np.asarray(nodes, dtype=np.int64)[:, None] + np.arange(3)).ravel()

    def averaged(self, e: AveragingElement) -> np.ndarray:
        """Rows of the motions that are in a mean: translations of all its nodes, then rotations of those that turn it."""
        turned = np.repeat(e.turned, 3)
        return np.concatenate([self.translations(e.nodes), self.of(turned, np.arange(len(turned)) % 3 + 3)])

    def axes_of(self, nodes: np.ndarray) -> np.ndarray:
        """Axes (k, 3, 3) of nodes (k,)."""
        axes = np.tile(np.eye(3), (len(nodes), 1, 1))
        if self.axes:
            for i, node in enumerate(np.asarray(nodes).tolist()):
                axes[i] = self.axes.get(node, axes[i])
        return axes

    def turn(self) -> sparse.csr_array | None:
        """Q (size, size) of z = Q z', the axes of every node on its diagonal; None where all are basic."""
        if not self.axes:
            return None
        starts = [
            (row, axes) for node, axes in self.axes.items() for row in (3 * node, self.first.get(node, -1)) if row >= 0
        ]
        first = np.array([row for row, _ in starts])
        plain = np.ones(self.size, dtype=bool)
        plain[(first[:, None] + np.arange(3)).ravel()] = False
        same = np.flatnonzero(plain)
        rows = np.concatenate([same, (first[:, None, None] + np.arange(3)[:, None] + np.zeros(3, int)).ravel()])
        columns = np.concatenate([same, (first[:, None, None] + np.arange(3) + np.zeros((3, 1), int)).ravel()])
        values = np.concatenate([np.ones(len(same)), np.array([axes for _, axes in starts]).ravel()])
        return sparse.csr_array((values, (rows, columns)), shape=(self.size, self.size))


@dataclass
class Equations:
    """z'[row] = Σ value z'[column] for the dependent rows; by: row → the element that says so."""

    size: int
    rows: list[np.ndarray] = field(default_factory=list)
    columns: list[np.ndarray] = field(default_factory=list)
    values: list[np.ndarray] = field(default_factory=list)
    by: dict[int, Tie] = field(default_factory=dict)

    def add(
        self, mesh: Mesh, e: Tie, nodes: np.ndarray, rows: np.ndarray, columns: np.ndarray, values: np.ndarray
    ) -> None:
        """Let rows (m,), motions of nodes (m,), follow columns (c,) by values (m, c).

        Raises DeckError for a row that follows already.
        """
        for row, node in zip(rows.tolist(), nodes.tolist(), strict=True):
            self.claim(mesh, e, node, row)
        i, j = np.nonzero(values)
        self.state(rows[i], columns[j], values[i, j])

    def claim(self, mesh: Mesh, e: Tie, node: int, row: int) -> None:
        """Note that a tie says what a row, a motion of a node, does. Raises DeckError for a row that follows already."""
        if row in self.by:
            first = self.by[row]
            at = mesh.where(*entity_of(first)) if str(first) == str(e) else None
            raise DeckError(
                f"node {mesh.node_ids[node]} is dependent in {first}{f' ({at})' if at else ''} and in {e}",
                remedy="let it follow one of them only",
                entity=entity_of(e),
            )
        self.by[row] = e

    def state(self, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
        """Add entries (k,) of D."""
        self.rows.append(rows)
        self.columns.append(columns)
        self.values.append(values)

    def matrix(self) -> sparse.csr_array:
        """D (size, size) of z' = D z' on the dependent rows."""
        if not self.by:
            return sparse.csr_array((self.size, self.size))
        places = np.concatenate(self.rows), np.concatenate(self.columns)
        return sparse.csr_array((np.concatenate(self.values), places), shape=(self.size, self.size))
