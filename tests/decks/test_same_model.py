"""One model, written as Nastran, Abaqus, gmsh and VTU files, comes back with the same K, M, numbers and sets."""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
import pyvista

from strainsight.decks.abaqus.deck import read_abaqus
from strainsight.decks.gmsh.mesh import read_gmsh
from strainsight.decks.nastran.deck import read_nastran
from strainsight.decks.other.mesh import read_meshio
from strainsight.fem.assembly import assemble
from strainsight.mesh.model import Material, Mesh

from ..solids import HEX, SOLIDS, SQUARE, WEDGE, Solid

STEEL = Material(1, 2.1e11, 0.3, 7850.0)
RUBBER = Material(2, 5.0e6, 0.45, 1100.0)
REGIONS = {11: ("STEEL", STEEL), 12: ("RUBBER", RUBBER)}

EDGES = {"vtk": "edges", "abaqus": "edges", "nastran": "nastran_edges", "gmsh": "gmsh_edges"}


@dataclass(frozen=True)
class Element:
    """kind; corners by node number; mid-side nodes by the pair of their corners, none if linear."""

    id: int
    kind: str
    region: int
    corners: list[int]
    middle: dict[frozenset[int], int]

    @property
    def solid(self) -> Solid:
        return SOLIDS[self.kind]

    def nodes(self, form: str) -> list[int]:
        edges = getattr(self.solid, EDGES[form])
        return self.corners + [self.middle[frozenset((self.corners[a], self.corners[b]))] for a, b in edges]


class Model:
    """Every kind, a quadratic hexahedron beside a wedge, curved; numbers out of order."""

    def __init__(self):
        self.x: dict[int, tuple[float, float, float]] = {}
        self.elements: list[Element] = []
        self._at: dict[tuple[float, ...], int] = {}
        beside = [(1, 0, 0), (2, 0, 0), (1, 1, 0), (1, 0, 1), (2, 0, 1), (1, 1, 1)]
        self.add("hex8", 11, HEX)
        self.add("hex8", 12, [(x, y, z + 1) for x, y, z in HEX])
        self.add("wedge6", 12, beside)
        self.add("hex20", 12, [(x + 4, y, z) for x, y, z in HEX])
        self.add("wedge15", 11, [(x + 4, y, z) for x, y, z in beside])
        self.add("tet10", 11, [(8, 0, 0), (9, 0, 0), (8, 1, 0), (8, 0, 1)])
        self.add("tet10", 11, [(9, 0, 0), (9, 1, 1), (8, 1, 0), (8, 0, 1)])
        self.add("pyra5", 11, [*((x, y, 2) for x, y in SQUARE), (0.5, 0.25, 3)])
        self.add("tet4", 12, [(12, 0, 0), (13, 0, 0), (12, 1, 0), (12, 0, 1)])
        self.foot = self.elements[0].corners[:4]

    def add(self, kind, region, corners):
        ids = [self.node(p) for p in corners]
        middle = {
            frozenset((ids[a], ids[b])): self.node((np.array(corners[a], float) + corners[b]) / 2)
            for a, b in SOLIDS[kind].edges
        }
        self.elements.append(Element(900 - 37 * len(self.elements), kind, region, ids, middle))

    def node(self, point) -> int:
        """The node at a point of the straight model; coordinates are multiples of 1/128, which every format writes exactly."""
        key = tuple(map(float, point))
        if key not in self._at:
            k = len(self._at)
            self._at[key] = 1 + (k * 59) % 199 * 3
            x, y, z = key
            bent = (x + y * z / 16, y + x / 32, z + x * y / 32 + (x % 1) / 64)
            self.x[self._at[key]] = tuple(float(np.round(128 * v) / 128) for v in bent)
        return self._at[key]


MODEL = Model()


def nastran(path):
    lines = ["SOL 103", "CEND", "SPC = 4", "BEGIN BULK"]
    lines += [f"GRID,{i},,{x!r},{y!r},{z!r}" for i, (x, y, z) in MODEL.x.items()]
    for e in MODEL.elements:
        fields = [str(e.id), str(e.region), *map(str, e.nodes("nastran"))]
        rows = [fields[i : i + 8] for i in range(0, len(fields), 8)]
        lines += [",".join([e.solid.nastran if i == 0 else "+", *row]) for i, row in enumerate(rows)]
    for i, (_, m) in REGIONS.items():
        lines += [f"PSOLID,{i},{m.id}", f"MAT1,{m.id},{m.youngs_modulus!r},,{m.poisson_ratio!r},{m.density!r}"]
    lines += ["SPC1,4,123," + ",".join(map(str, MODEL.foot)), "SET1,5," + ",".join(map(str, MODEL.foot)), "ENDDATA", ""]
    path.write_text("\n".join(lines))
    return read_nastran(path)


def abaqus(path):
    lines = ["*NODE", *(f"{i}, {x!r}, {y!r}, {z!r}" for i, (x, y, z) in MODEL.x.items())]
    for e in MODEL.elements:
        fields = [str(e.id), *map(str, e.nodes("abaqus"))]
        lines += [f"*ELEMENT, TYPE={e.solid.abaqus}, ELSET={REGIONS[e.region][0]}", ", ".join(fields[:12])]
        lines[-1] += "," if fields[12:] else ""
        lines += [", ".join(fields[12:])] if fields[12:] else []
    lines += ["*NSET, NSET=FOOT", ", ".join(map(str, MODEL.foot))]
    for name, m in REGIONS.values():
        lines += [f"*MATERIAL, NAME=M-{name}", "*ELASTIC", f"{m.youngs_modulus!r}, {m.poisson_ratio!r}"]
        lines += ["*DENSITY", f"{m.density!r}", f"*SOLID SECTION, ELSET={name}, MATERIAL=M-{name}"]
    path.write_text("\n".join([*lines, "*BOUNDARY", "FOOT, 1, 3", ""]))
    return read_abaqus(path)


NAMES = '$PhysicalNames\n3\n2 4 "FOOT"\n3 11 "STEEL"\n3 12 "RUBBER"\n$EndPhysicalNames\n'
QUADRANGLE = 3


def section(name: str, body: bytes) -> bytes:
    return f"${name}\n".encode() + body + f"\n$End{name}\n".encode()


def gmsh_2(path, binary):
    rows = [(1, QUADRANGLE, 4, MODEL.foot), *((e.id, e.solid.gmsh, e.region, e.nodes("gmsh")) for e in MODEL.elements)]
    if binary:
        head = b"2.2 1 8\n" + struct.pack("<i", 1)
        nodes = b"".join(struct.pack("<iddd", i, *x) for i, x in MODEL.x.items())
        elements = b"".join(struct.pack(f"<6i{len(n)}i", t, 1, 2, i, g, g, *n) for i, t, g, n in rows)
    else:
        head = b"2.2 0 8"
        nodes = "\n".join(f"{i} {x!r} {y!r} {z!r}" for i, (x, y, z) in MODEL.x.items()).encode()
        elements = "\n".join(f"{i} {t} 2 {g} {g} " + " ".join(map(str, n)) for i, t, g, n in rows).encode()
    counted = [f"{len(part)}\n".encode() + body for part, body in ((MODEL.x, nodes), (rows, elements))]
    content = (
        section("MeshFormat", head) + NAMES.encode() + section("Nodes", counted[0]) + section("Elements", counted[1])
    )
    path.write_bytes(content)
    return read_gmsh(path)


def grid(path, binary=True):
    """VTK's wedges are written mirrored: the normal of their first triangle points out of the cell."""
    index = {i: k for k, i in enumerate(MODEL.x)}
    cells = []
    for e in MODEL.elements:
        turned = replace(e, corners=[e.corners[i] for i in (0, 2, 1, 3, 5, 4)]) if e.solid.corners == WEDGE else e
        nodes = turned.nodes("vtk")
        cells += [len(nodes), *(index[i] for i in nodes)]
    out = pyvista.UnstructuredGrid(
        np.array(cells), [e.solid.vtk for e in MODEL.elements], np.array([*MODEL.x.values()])
    )
    out.point_data["node_id"] = list(MODEL.x)
    out.point_data["FOOT"] = [int(i in MODEL.foot) for i in MODEL.x]
    out.cell_data["element_id"] = [e.id for e in MODEL.elements]
    out.cell_data["region"] = [e.region for e in MODEL.elements]
    for number, (name, _) in REGIONS.items():
        out.cell_data[name] = [int(e.region == number) for e in MODEL.elements]
    out.save(path, binary=binary)
    return read_meshio(path)


FORMATS = {
    "nastran": lambda folder: nastran(folder / "part.bdf"),
    "abaqus": lambda folder: abaqus(folder / "part.inp"),
    "gmsh 2.2": lambda folder: gmsh_2(folder / "part.msh", False),
    "gmsh 2.2 binary": lambda folder: gmsh_2(folder / "part.msh", True),
    "vtu": lambda folder: grid(folder / "part.vtu"),
    "vtu text": lambda folder: grid(folder / "part.vtu", False),
    "vtk": lambda folder: grid(folder / "part.vtk"),
}


def with_materials(mesh: Mesh) -> Mesh:
    if mesh.materials:
        return mesh
    regions = {i: replace(region, material=REGIONS[i][1].id) for i, region in mesh.regions.items()}
    return replace(mesh, regions=regions, materials={m.id: m for _, m in REGIONS.values()})


def by_number(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    order = (3 * np.argsort(mesh.node_ids)[:, None] + np.arange(3)).ravel()
    return tuple(operator.constant.toarray()[np.ix_(order, order)] for operator in assemble(with_materials(mesh)))


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    return {name: read(tmp_path_factory.mktemp("same")) for name, read in FORMATS.items()}


@pytest.mark.parametrize(("first", "second"), list(pairwise(FORMATS)))
def test_stiffness_and_mass_are_the_same(meshes, first, second):
    for own, other in zip(by_number(meshes[first]), by_number(meshes[second]), strict=True):
        assert np.abs(own - other).max() <= 1e-12 * np.abs(own).max()


@pytest.mark.parametrize("name", FORMATS)
def test_numbers_positions_and_connectivity_are_those_of_the_model(meshes, name):
    mesh = meshes[name]
    assert sorted(mesh.node_ids.tolist()) == sorted(MODEL.x)
    assert {int(i): tuple(x.tolist()) for i, x in zip(mesh.node_ids, mesh.position, strict=True)} == MODEL.x
    found = {int(i): mesh.node_ids[n].tolist() for b in mesh.blocks for i, n in zip(b.ids, b.nodes, strict=True)}
    assert {i: set(n) for i, n in found.items()} == {e.id: set(e.nodes("vtk")) for e in MODEL.elements}


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "nastran"])
def test_sets_are_the_same(meshes, name):
    mesh = meshes[name]
    assert mesh.node_sets["FOOT"].tolist() == sorted(MODEL.foot)
    for number, (title, _) in REGIONS.items():
        own = sorted(e.id for e in MODEL.elements if e.region == number)
        assert np.sort(mesh.element_sets[title]).tolist() == own


def test_supports_agree_between_formats(meshes):
    held = [
        sorted((int(mesh.node_ids[node]), int(component)) for node, component in mesh.fixed)
        for mesh in (meshes["nastran"], meshes["abaqus"])
    ]
    assert held[0] == held[1] == sorted((node, component) for node in MODEL.foot for component in range(3))
    assert meshes["nastran"].node_sets["SET1-5"].tolist() == sorted(MODEL.foot)
