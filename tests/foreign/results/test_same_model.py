"""One model through files of two kinds, one of them along cylindrical axes of nodes: the modes that SciPy found come back."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.config.mesh import MeshFile
from strainsight.decks.reader import read_mesh
from strainsight.experiment.structure.results import model_of_results
from strainsight.fem.model import nodal

from ...frd import solved
from . import test_op2

MODES, CENTRE = 3, np.array([-1.0, -2.0, 0.0])
LAYERS, HELD = 4, (1, 2, 3, 4)
SQUARE = [(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1)]
POSITION = {4 * k + j + 1: (x, y, 0.2 * k) for k in range(LAYERS) for j, (x, y) in enumerate(SQUARE)}


@pytest.fixture(scope="module")
def deck(tmp_path_factory):
    """A column of hexahedra whose nodes move along cylindrical axes about z through CENTRE."""
    cards = ["BEGIN BULK", "CORD2C,5,,-1.,-2.,0.,-1.,-2.,1.", "+,0.,-2.,0."]
    cards += [f"GRID,{node},,{x:.3f},{y:.3f},{z:.3f},5" for node, (x, y, z) in POSITION.items()]
    for k in range(LAYERS - 1):
        nodes = [4 * k + j + 1 for j in range(8)]
        cards += [f"CHEXA,{k + 1},1,{','.join(map(str, nodes[:6]))}", f"+,{nodes[6]},{nodes[7]}"]
    cards += ["PSOLID,1,1", "MAT1,1,2.1+11,,.3,7850.", f"SPC1,1,123,{','.join(map(str, HELD))}", "ENDDATA"]
    path = tmp_path_factory.mktemp("deck") / "column.bdf"
    path.write_text("SOL 103\nCEND\nSPC = 1\n" + "\n".join(cards) + "\n")
    return path


@pytest.fixture(scope="module")
def mesh(deck):
    return read_mesh(deck)


@pytest.fixture(scope="module")
def found(mesh):
    return solved(mesh, [], MODES)


def along_node_axes(mesh, shape):
    """(n, 6) along e_r, e_θ, z, without rotations."""
    out = np.zeros((len(shape), 6))
    for row, (x, u) in enumerate(zip(mesh.position - CENTRE, shape, strict=True)):
        c, s = x[:2] / np.hypot(*x[:2])
        out[row, :3] = c * u[0] + s * u[1], -s * u[0] + c * u[1], u[2]
    return out


def write_op2(path, mesh, found):
    w = test_op2.Writer(width=8)
    records = []
    for k, f in enumerate(found.frequency):
        motion = np.vstack([along_node_axes(mesh, found.shapes[:, :, k]), np.ones(6)])
        types = [1] * len(mesh.node_ids) + [2]
        records += [
            w.identification(test_op2.MODE, 7, mode=k + 1, eigenvalue=float((2 * np.pi * f) ** 2)),
            w.rows([*mesh.node_ids.tolist(), 900], motion, types),
        ]
    path.write_bytes(w.file(w.block("OUGV1", *records)))


def write_vtu(path, mesh, found):
    import meshio

    data = {f"mode_{k + 1}_{float(f):.15g}Hz": found.shapes[:, :, k] for k, f in enumerate(found.frequency)}
    data["node_id"] = mesh.node_ids
    meshio.Mesh(mesh.position, [("hexahedron", np.arange(8)[None])], point_data=data).write(path)


@pytest.mark.parametrize(("ending", "write", "digits"), [("op2", write_op2, 1e-9), ("vtu", write_vtu, 1e-9)])
def test_modes_are_on_deck_nodes(tmp_path, deck, mesh, found, ending, write, digits):
    path = tmp_path / f"run.{ending}"
    write(path, mesh, found)
    config = MeshFile(file=deck.name, results={"file": path.name})
    own = model_of_results(config, mesh, [], {"mesh.results.file": path}, None)
    assert own.modes == MODES
    lam = np.diag(own.model.stiffness.at({}).toarray())
    np.testing.assert_allclose(np.sqrt(lam) / (2 * np.pi), found.frequency, rtol=digits)
    shapes = nodal(own.model, np.eye(MODES)).reshape(len(mesh.position), 3, MODES)
    for k in range(MODES):
        scale = np.abs(found.shapes[:, :, k]).max()
        np.testing.assert_allclose(shapes[:, :, k], found.shapes[:, :, k], rtol=0, atol=digits * scale)
    said = [note for note in own.notes if "scalar" in note]
    assert said == (["scalar or fluid points of run.op2 are omitted (1 in total)"] if ending == "op2" else [])
