"""A `Mesh` as datasets of an artefact, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from strainsight.mesh.model import (
    ELEMENT_KINDS,
    AveragingElement,
    CellBlock,
    Material,
    Mesh,
    NodalForces,
    PointMass,
    Region,
    RigidElement,
)
from strainsight.records.below import Below
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.output import Dataset


def mesh_datasets(mesh: Mesh) -> dict[str, Dataset]:
    """Everything of a mesh, under the paths that `mesh_from` reads; lists of unequal length as offset and members."""
    record = {
        "/nodes/id": Dataset(mesh.node_ids, "1", "id of every node in the deck"),
        "/nodes/position": Dataset(mesh.position, "m", "position of every node (node × xyz)", ("/nodes/id", "")),
        "/constraints/fixed": Dataset(
            mesh.fixed, "1", "components held at zero (row × [node index, component]; 0-2 motions, 3-5 rotations)"
        ),
    }
    for block in mesh.blocks:
        place = f"/cells/{block.kind}"
        record[f"{place}/id"] = Dataset(block.ids, "1", f"id of every {block.kind} in the deck")
        record[f"{place}/nodes"] = Dataset(block.nodes, "1", "node indices in VTK order (element × node)")
        record[f"{place}/region"] = Dataset(block.region, "1", "region id of every element")
    regions, materials = list(mesh.regions.values()), list(mesh.materials.values())
    record |= _columns(
        "/regions",
        "region",
        {
            "id": ("1", [r.id for r in regions], int),
            "name": ("1", [r.name for r in regions], str),
            "material": ("1", [r.material for r in regions], int),
        },
    )
    record |= _columns(
        "/materials",
        "material",
        {
            "id": ("1", [m.id for m in materials], int),
            "youngs_modulus": ("Pa", [m.youngs_modulus for m in materials], float),
            "poisson_ratio": ("1", [m.poisson_ratio for m in materials], float),
            "density": ("kg/m^3", [m.density for m in materials], float),
            "name": ("1", [m.name for m in materials], str),
        },
    )
    record |= _columns(
        "/constraints/rigid",
        "rigid element (RBE2)",
        {
            "id": ("1", [e.id for e in mesh.rigid], int),
            "reference": ("1", [e.reference for e in mesh.rigid], int),
            "components": ("1", [_letters(e.components) for e in mesh.rigid], str),
            "name": ("1", [e.name for e in mesh.rigid], str),
        },
    ) | _ragged("/constraints/rigid", "nodes", "dependent node indices", [e.nodes for e in mesh.rigid], "1", int)
    record |= _columns(
        "/constraints/averaging",
        "averaging element (RBE3)",
        {
            "id": ("1", [e.id for e in mesh.averaging], int),
            "reference": ("1", [e.reference for e in mesh.averaging], int),
            "components": ("1", [_letters(e.components) for e in mesh.averaging], str),
            "name": ("1", [e.name for e in mesh.averaging], str),
        },
    )
    record |= _ragged("/constraints/averaging", "nodes", "node indices", [e.nodes for e in mesh.averaging], "1", int)
    record |= _ragged("/constraints/averaging", "weight", "weights", [e.weight for e in mesh.averaging], "1", float)
    counted = [np.ones((len(e.nodes), 3), bool) if e.directions is None else e.directions for e in mesh.averaging]
    solved = [np.zeros((0, 2), np.int64) if e.dependent is None else e.dependent for e in mesh.averaging]
    record |= _ragged(
        "/constraints/averaging",
        "directions",
        "1 where a translation of a node counts (node × xyz)",
        counted,
        "1",
        int,
        (3,),
    )
    record |= _ragged(
        "/constraints/averaging",
        "dependent",
        "[node index, component] that the relations are solved for (UM); none: the reference's own",
        solved,
        "1",
        int,
        (2,),
    )
    record |= {
        "/constraints/axes/node": Dataset(
            np.array(list(mesh.axes), dtype=np.int64), "1", "node indices with a displacement system of their own"
        ),
        "/constraints/axes/direction": Dataset(
            np.array(list(mesh.axes.values()), dtype=float).reshape(-1, 3, 3),
            "1",
            "their axes (node × xyz × axis)",
        ),
    }
    record |= _columns(
        "/masses",
        "point mass",
        {
            "id": ("1", [p.id for p in mesh.point_masses], int),
            "node": ("1", [p.node for p in mesh.point_masses], int),
            "mass": ("kg", [p.mass for p in mesh.point_masses], float),
        },
    )
    record["/masses/offset"] = Dataset(
        np.array([p.offset for p in mesh.point_masses]).reshape(-1, 3), "m", "centre of mass from the node (mass × xyz)"
    )
    record["/masses/inertia"] = Dataset(
        np.array([p.inertia for p in mesh.point_masses]).reshape(-1, 3, 3),
        "kg m^2",
        "inertia about the centre of mass (mass × xyz × xyz)",
    )
    record |= _columns("/loads", "load of the deck", {"name": ("1", list(mesh.loads), str)})
    record |= _ragged("/loads", "nodes", "loaded node indices", [load.nodes for load in mesh.loads.values()], "1", int)
    record |= _ragged(
        "/loads", "force", "forces (node × xyz)", [load.force for load in mesh.loads.values()], "N", float, (3,)
    )
    for kind, sets in (("nodes", mesh.node_sets), ("elements", mesh.element_sets)):
        record |= _columns(f"/sets/{kind}", f"set of {kind}", {"name": ("1", list(sets), str)})
        record |= _ragged(f"/sets/{kind}", "members", "ids of the deck", list(sets.values()), "1", int)
    record |= _columns(
        "/ignored",
        "kind of card that was not taken over",
        {
            "card": ("1", list(mesh.ignored), str),
            "count": ("1", list(mesh.ignored.values()), int),
        },
    )
    record["/notes"] = Dataset(np.array(list(mesh.notes), dtype=np.str_), "1", "how something was taken over")
    return record


def mesh_from(artefact: Artefact | Below) -> Mesh:
    """The mesh that `mesh_datasets` wrote; lengths in m."""
    a = artefact
    blocks = tuple(
        CellBlock(kind, a[f"/cells/{kind}/id"], a[f"/cells/{kind}/nodes"], a[f"/cells/{kind}/region"])
        for kind in ELEMENT_KINDS
        if "/cells" in a and kind in a.groups("/cells")
    )
    materials = zip(
        *(a[f"/materials/{c}"].tolist() for c in ("id", "youngs_modulus", "poisson_ratio", "density")),
        _text(a["/materials/name"]),
        strict=True,
    )
    regions = zip(a["/regions/id"].tolist(), _text(a["/regions/name"]), a["/regions/material"].tolist(), strict=True)
    rigid = zip(
        a["/constraints/rigid/id"].tolist(),
        a["/constraints/rigid/reference"].tolist(),
        _split(a, "/constraints/rigid/nodes"),
        _text(a["/constraints/rigid/components"]),
        _text(a["/constraints/rigid/name"]),
        strict=True,
    )
    averaging = zip(
        a["/constraints/averaging/id"].tolist(),
        a["/constraints/averaging/reference"].tolist(),
        _split(a, "/constraints/averaging/nodes"),
        _split(a, "/constraints/averaging/weight"),
        _text(a["/constraints/averaging/components"]),
        [entry.astype(bool) for entry in _split(a, "/constraints/averaging/directions")],
        [entry if len(entry) else None for entry in _split(a, "/constraints/averaging/dependent")],
        _text(a["/constraints/averaging/name"]),
        strict=True,
    )
    masses = zip(
        a["/masses/id"].tolist(),
        a["/masses/node"].tolist(),
        a["/masses/mass"].tolist(),
        a["/masses/offset"],
        a["/masses/inertia"],
        strict=True,
    )
    forces = zip(_text(a["/loads/name"]), _split(a, "/loads/nodes"), _split(a, "/loads/force"), strict=True)
    sets = {
        kind: dict(zip(_text(a[f"/sets/{kind}/name"]), _split(a, f"/sets/{kind}/members"), strict=True))
        for kind in ("nodes", "elements")
    }
    return Mesh(
        node_ids=a["/nodes/id"],
        position=a["/nodes/position"],
        blocks=blocks,
        regions={row[0]: Region(*row) for row in regions},
        materials={row[0]: Material(*row) for row in materials},
        fixed=a["/constraints/fixed"].reshape(-1, 2),
        rigid=tuple(RigidElement(i, ref, nodes, _components(c), name) for i, ref, nodes, c, name in rigid),
        averaging=tuple(
            AveragingElement(i, ref, nodes, w, _components(c), directions, dependent, name)
            for i, ref, nodes, w, c, directions, dependent, name in averaging
        ),
        point_masses=tuple(PointMass(*row) for row in masses),
        axes=dict(zip(a["/constraints/axes/node"].tolist(), a["/constraints/axes/direction"], strict=True)),
        node_sets=sets["nodes"],
        element_sets=sets["elements"],
        loads={name: NodalForces(nodes, force) for name, nodes, force in forces},
        notes=tuple(_text(a["/notes"])),
        ignored=dict(zip(_text(a["/ignored/card"]), a["/ignored/count"].tolist(), strict=True)),
    )


def _columns(group: str, what: str, columns: Mapping[str, tuple[str, list, type]]) -> dict[str, Dataset]:
    def array(values: list, kind: type) -> np.ndarray:
        return np.array(values, dtype=np.str_ if kind is str else np.int64 if kind is int else np.float64)

    return {
        f"{group}/{name}": Dataset(array(values, kind), unit, f"{name.replace('_', ' ')} of every {what}")
        for name, (unit, values, kind) in columns.items()
    }


def _ragged(
    group: str, name: str, what: str, lists: Sequence[np.ndarray], unit: str, kind: type, tail: tuple[int, ...] = ()
) -> dict[str, Dataset]:
    """Lists of entries of shape `tail`, one behind the other."""
    offset = np.concatenate([[0], np.cumsum([len(entry) for entry in lists])]).astype(np.int64)
    flat = np.concatenate([np.zeros((0, *tail), kind), *(np.asarray(entry, kind) for entry in lists)])
    return {
        f"{group}/{name}": Dataset(flat, unit, f"{what}, all lists one behind the other"),
        f"{group}/{name}_offset": Dataset(offset, "1", f"list i of {name} is [offset[i], offset[i + 1])"),
    }


def _split(artefact: Artefact | Below, path: str) -> list[np.ndarray]:
    offset = artefact[f"{path}_offset"]
    return np.split(artefact[path], offset[1:-1]) if len(offset) > 1 else []


def _text(array: np.ndarray) -> list[str]:
    return [str(value) for value in array]


def _letters(components: tuple[int, ...]) -> str:
    return "".join(str(c + 1) for c in components)


def _components(letters: str) -> tuple[int, ...]:
    return tuple(int(letter) - 1 for letter in letters)
