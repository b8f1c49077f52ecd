"""Second-order elements whose nodes are in the order of another program are refused for that reason, in every format."""

from __future__ import annotations

import itertools
from pathlib import Path

import meshio
import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError
from strainsight.mesh.given_sections import GivenSection
from strainsight.mesh.thin import ShellSection

from ..solids import SOLIDS


def two(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Positions and nodes (VTK order) of two elements side by side that share no node."""
    first = SOLIDS[kind].points()
    return np.vstack([first, first + np.array([3.0, 0, 0])]), np.arange(2 * len(first)).reshape(2, -1)


def rolled(nodes: np.ndarray, corners: int) -> np.ndarray:
    return np.hstack([nodes[:, :corners], np.roll(nodes[:, corners:], 1, axis=1)])


def write(path: Path, kind: str, x: np.ndarray, nodes: np.ndarray) -> None:
    """A mesh of one kind, whose nodes are in the order of VTK."""
    solid, numbered = SOLIDS[kind], list(enumerate(x.tolist(), start=1))
    if path.suffix == ".inp":
        lists = [[", ".join(map(str, part + 1)) for part in (own[:8], own[8:])] for own in nodes]
        cells = "".join(f"{i}, {first},\n{rest}\n" for i, (first, rest) in enumerate(lists, 1))
        lines = "".join(f"{i}, {p[0]}, {p[1]}, {p[2]}\n" for i, p in numbered)
        path.write_text(f"*NODE\n{lines}*ELEMENT, TYPE={solid.abaqus}\n{cells}")
    elif path.suffix == ".bdf":
        corners, other = len(solid.corners), solid.nastran_edges or solid.edges
        order = [*range(corners), *(corners + solid.edges.index(edge) for edge in other)]
        cells = "".join(f"{solid.nastran},{i},1,{','.join(map(str, own[order] + 1))}\n" for i, own in enumerate(nodes, 1))
        path.write_text("".join(f"GRID,{i},,{p[0]},{p[1]},{p[2]}\n" for i, p in numbered) + cells + "PSOLID,1,1\n")
    else:
        options = {"file_format": "gmsh", "binary": False} if path.suffix == ".msh" else {}
        meshio.write(path, meshio.Mesh(x, [(solid.meshio, nodes)]), **options)


@pytest.mark.parametrize(
    ("kind", "ending"),
    [
        *itertools.product(["tet10", "hex20", "wedge15"], ["inp", "bdf"]),
        *itertools.product(["tet10", "hex20"], ["vtu", "vtk", "msh"]),
    ],
)
def test_mid_side_nodes_in_another_order_are_named(tmp_path, kind, ending):
    path, (x, nodes) = tmp_path / f"part.{ending}", two(kind)
    for order, wrong in ((nodes, False), (rolled(nodes, len(SOLIDS[kind].corners)), True)):
        write(path, kind, x, order)
        if not wrong:
            assert read_mesh(path, materials=False).blocks[0].kind == kind
            continue
        with pytest.raises(DeckError, match=r"in all 2 .* the order of the nodes is another one") as caught:
            read_mesh(path, materials=False)
        assert "merge" not in caught.value.remedy


def test_uprights_before_the_top_mid_sides_are_named(tmp_path):
    """The order of Nastran and Exodus in a VTU; the two share a face, so that this is not only seen at their facets."""
    solid = SOLIDS["hex20"]
    first = solid.points(solid.nastran_edges)
    points = np.round(np.vstack([first, first + np.array([1.0, 0, 0])]), 9)
    x, number = np.unique(points, axis=0, return_inverse=True)
    meshio.write(tmp_path / "two.vtu", meshio.Mesh(x, [("hexahedron20", number.reshape(2, 20))]))
    with pytest.raises(DeckError, match="the order of the nodes is another one"):
        read_mesh(tmp_path / "two.vtu", materials=False)


@pytest.mark.parametrize(("cell", "corners"), [("quad8", 4), ("triangle6", 3)])
def test_shells_in_another_order_are_named(tmp_path, cell, corners):
    ring = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])[:corners]
    x = np.vstack([ring, (ring + np.roll(ring, -1, axis=0)) / 2])
    given = {"mesh.sections.skin": GivenSection(None, ShellSection(0.01))}
    for order in (np.arange(2 * corners), np.r_[0:corners, np.roll(np.arange(corners, 2 * corners), 1)]):
        meshio.write(tmp_path / "skin.vtu", meshio.Mesh(x, [(cell, order[None])]))
        if order[corners] == corners:
            assert read_mesh(tmp_path / "skin.vtu", solids=False, materials=False, given=given).shells
            continue
        with pytest.raises(DeckError, match=r"in all 1 .* the order of the nodes is another one"):
            read_mesh(tmp_path / "skin.vtu", solids=False, materials=False, given=given)
