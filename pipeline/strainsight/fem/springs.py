"""Springs on the motions of their nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import AffineOperator, Parameter, from_entries
from strainsight.fem.equations import joined
from strainsight.mesh.additions import spring_names
from strainsight.mesh.model import Mesh

UNRESISTED = 1e-11
"""Share of the largest rotational stiffness of a node: a smaller one is rounding."""


def spring_rows(mesh: Mesh, rotation_rows: Mapping[int, int]) -> tuple[sparse.csr_array, np.ndarray]:
    """R (s, 3n + 3r) of the elongations s = R z, and the stiffness k (s,) of all springs; rotations of node i from row
    rotation_rows[i]. They are followed by springs about unconstrained axes of nodes whose rotations have springs only
    (AUTOSPC in Nastran).

    Raises DeckError where a spring acts on the rotation of a node without rotations."""
    size = 3 * len(mesh.position) + 3 * len(rotation_rows)
    entries, stiffness, count = [], [np.zeros(0)], 0
    for spring in mesh.springs:
        at = 3 * spring.node + spring.component
        for i in np.flatnonzero((spring.component > 2) & (spring.value != 0)):
            node = int(spring.node[i])
            if node not in rotation_rows:
                raise DeckError(
                    f"{spring} acts on rotations of node {mesh.node_ids[node]}, which has no rotations",
                    remedy="Make the node the reference node of a tie (RBE2, mesh.ties), clamp its rotations, or move the "
                    "two nodes of the spring to the same position.",
                    entity=("node", int(mesh.node_ids[node])),
                )
            at[i] = rotation_rows[node] + spring.component[i] - 3
        entries.append((spring.value, spring.spring + count, at))
        stiffness.append(spring.stiffness)
        count += len(spring.stiffness)
    if not entries:
        return sparse.csr_array((0, size)), np.zeros(0)
    R, k = from_entries(entries, (count, size)), np.concatenate(stiffness)
    autospc, autospc_stiffness = _autospc_springs(mesh, rotation_rows, R, k)
    return sparse.csr_array(sparse.vstack([R, autospc])), np.concatenate([k, autospc_stiffness])


def _turned_by_springs_only(mesh: Mesh, rotation_rows: Mapping[int, int]) -> list[int]:
    """Nodes with rotational springs, but without elements or ties on their rotations."""
    return sorted({*mesh.turned_by_springs.tolist()} & rotation_rows.keys() - joined(mesh))


def _autospc_springs(
    mesh: Mesh, rotation_rows: Mapping[int, int], R: sparse.csr_array, k: np.ndarray
) -> tuple[sparse.csr_array, np.ndarray]:
    """Springs (s, 3n + 3r) about the axes v of single nodes with (Σ k r rᵀ + k̂ Σ e eᵀ) v = 0, r the rotations of the node in
    each spring, e the clamped rotations, k̂ the largest stiffness there; and their stiffness k̂ (s,)."""
    entries: list[tuple[np.ndarray, int, np.ndarray]] = []
    stiffness = []
    for node in _turned_by_springs_only(mesh, rotation_rows):
        at = rotation_rows[node] + np.arange(3)
        r = R[:, at].toarray()
        B = (r * k[:, None]).T @ r
        strength = float(np.linalg.eigvalsh(B)[-1]) or 1.0
        clamped = mesh.fixed[(mesh.fixed[:, 0] == node) & (mesh.fixed[:, 1] > 2), 1] - 3
        e = mesh.axes.get(node, np.eye(3))[:, clamped]
        size, v = np.linalg.eigh(B + strength * e @ e.T)
        for axis in v.T[size <= UNRESISTED * strength]:
            entries.append((axis, len(entries), at))
            stiffness.append(strength)
    return from_entries(entries, (len(entries), R.shape[1])), np.array(stiffness)


def spring_owners(mesh: Mesh, springs: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Name of a spring → the parameter of its stiffness; springs: the names of each parameter.

    Raises UserError for springs that do not exist, have no stiffness, or have two parameters."""
    owner: dict[str, str] = {}
    for parameter, wanted in springs.items():
        names = spring_names(mesh, wanted)
        if names and not any(spring.stiffness.any() for spring in mesh.springs if spring.name in names):
            raise UserError(
                f"the springs of parameter {parameter} have no stiffness",
                remedy="Specify a positive stiffness for these springs, or name other springs in `springs` of the parameter.",
            )
        for name in names:
            if (other := owner.setdefault(name, parameter)) != parameter:
                raise UserError(
                    f"parameters {other} and {parameter} both define the stiffness of spring {name}",
                    remedy="Remove one of the two parameters.",
                )
    return owner


def spring_operator(
    mesh: Mesh, rotation_rows: Mapping[int, int], parameters: Sequence[Parameter] = ()
) -> AffineOperator:
    """K(θ) = Rᵀ diag(k₀) R + Σ θᵢ Rᵀ diag(kᵢ) R on z (3n + 3r)² [N/m, N, N m]: kᵢ is k of the springs of parameter i and
    zero elsewhere, k₀ of the springs without a parameter.

    Raises the errors of `spring_rows` and `spring_owners`."""
    R, k = spring_rows(mesh, rotation_rows)
    factors = {parameter.name: parameter.springs for parameter in parameters if parameter.springs}
    owner = spring_owners(mesh, factors)
    of = np.repeat(
        [owner.get(spring.name, "") for spring in mesh.springs], [len(spring.stiffness) for spring in mesh.springs]
    )
    of = np.concatenate([of, np.full(len(k) - len(of), "")])

    def part(parameter: str) -> sparse.csr_array:
        return sparse.csr_array(R.T @ (sparse.diags_array(np.where(of == parameter, k, 0.0)) @ R))

    return AffineOperator(part(""), {name: part(name) for name in factors})


def sprung_rows(mesh: Mesh, rotation_rows: Mapping[int, int]) -> np.ndarray:
    """Rows of z that springs act on: translations, and all rotations of nodes that only springs turn."""
    spring_rows_of_z = [3 * spring.node + spring.component for spring in mesh.springs]
    acts = [
        (spring.component < 3) & (spring.value != 0) & (spring.stiffness[spring.spring] > 0) for spring in mesh.springs
    ]
    turned = [rotation_rows[node] + np.arange(3) for node in _turned_by_springs_only(mesh, rotation_rows)]
    translations = (rows[on] for rows, on in zip(spring_rows_of_z, acts, strict=True))
    return np.unique(np.concatenate([np.zeros(0, np.int64), *translations, *turned]))
