"""Files of results as CalculiX writes them, from motions that are known; and decks for CalculiX itself."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import eigsh, splu

from strainsight.fem.model import build_model, nodal

from .solids import SOLIDS

TYPES = {"hex8": 1, "wedge6": 2, "tet4": 3, "hex20": 4, "wedge15": 5, "tet10": 6}
ABAQUS = {"hex8": "C3D8I", "wedge6": "C3D6", "tet4": "C3D4", "hex20": "C3D20", "wedge15": "C3D15", "tet10": "C3D10"}
"""Elements whose order of nodes is the same in both."""


@dataclass(frozen=True)
class Found:
    """frequency (m,) [Hz], shapes (n, 3, m) of unit mass and static (n, 3, s) [m/N], on the nodes of a mesh."""

    frequency: np.ndarray
    shapes: np.ndarray
    static: np.ndarray


def solved(mesh, forces, modes) -> Found:
    """Modes and static responses by SciPy on the assembled matrices; forces: s lists of (node id, (3,) force)."""
    model = build_model(mesh)
    K, M = (sparse.csc_array(X.at({})) for X in (model.stiffness, model.mass))
    lam, phi = eigsh(K, modes, M=M, sigma=0.0, v0=np.ones(K.shape[0]))
    T = model.constraint.transform
    e = np.zeros((T.shape[0], len(forces)))
    for j, own in enumerate(forces):
        for node, force in own:
            row = 3 * int(np.flatnonzero(mesh.node_ids == node)[0])
            e[row : row + 3, j] += force
    z = splu(K).solve(T.T @ e)
    n = len(mesh.position)
    return Found(np.sqrt(lam) / (2 * np.pi), nodal(model, phi).reshape(n, 3, -1), nodal(model, z).reshape(n, 3, -1))


def write_frd(path, mesh, found: Found, nodes=None, form=1, mass=1.0, applied=1.0) -> None:
    """Static steps 1 to s, then one of modes; form: 1 text, 2 single, 3 double precision; nodes: indices of those written."""
    nodes = np.arange(len(mesh.position)) if nodes is None else nodes
    ids = mesh.node_ids[nodes]
    with path.open("wb") as file:
        file.write(b"    1C\n    1UMAT    1STEEL\n")
        file.write(f"    2C{'':18}{len(ids):12d}{'':37}{3 if form > 1 else 1}\n".encode())
        _rows(file, ids, mesh.position[nodes], 3 if form > 1 else 1)
        count = sum(len(block.ids) for block in mesh.blocks)
        file.write(f"    3C{'':18}{count:12d}{'':37}{1}\n".encode())
        for block in mesh.blocks:
            solid = SOLIDS[
                block.kind
            ]  # mid-sides of uprights stand before those of the top, as Nastran has them (cgx manual)
            mids = [len(solid.corners) + solid.edges.index(edge) for edge in solid.nastran_edges]
            order = [*range(len(solid.corners)), *mids]
            for number, own in zip(block.ids, mesh.node_ids[block.nodes][:, order], strict=True):
                file.write(f" -1{number:10d}{TYPES[block.kind]:5d}    0    1\n".encode())
                for start in range(0, len(own), 10):
                    file.write((" -2" + "".join(f"{n:10d}" for n in own[start : start + 10]) + "\n").encode())
        file.write(b" -3\n")
        steps = found.static.shape[2]
        for j in range(steps):
            file.write(f"    1PSTEP{j + 1:26d}{1:12d}{j + 1:12d}\n".encode())
            _block(file, ids, applied * found.static[nodes, :, j], 1.0, 0, form)
        for i, frequency in enumerate(found.frequency):
            file.write(f"    1PSTEP{steps + i + 1:26d}{1:12d}{steps + 1:12d}\n".encode())
            if mass is not None:
                file.write(f"    1PGM                {mass:.6E}\n".encode())
            file.write(f"    1PMODE{i + 1:26d}\n".encode())
            _block(file, ids, found.shapes[nodes, :, i] * np.sqrt(mass or 1.0), frequency, 2, form)
        file.write(b" 9999\n")


def _block(file, ids, values, value, analysis, form) -> None:
    file.write(f"  100CL  101{value:#.10g}"[:24].ljust(24).encode())
    file.write(f"{len(ids):12d}{'':20}{analysis:2d}{1:5d}{'':10}{form:2d}\n".encode())
    file.write(b" -4  DISP        4    1\n")
    for k in range(3):
        file.write(f" -5  D{k + 1}          1    2{k + 1:5d}    0\n".encode())
    file.write(b" -5  ALL         1    2    0    0    1ALL\n")
    _rows(file, ids, values, form)


def _rows(file, ids, values, form) -> None:
    if form == 1:
        for number, row in zip(ids.tolist(), values.tolist(), strict=True):
            file.write(f" -1{number:10d}{row[0]:12.5E}{row[1]:12.5E}{row[2]:12.5E}\n".encode())
        file.write(b" -3\n")
        return
    table = np.zeros(len(ids), dtype=[("node", "<i4"), ("value", "<f4" if form == 2 else "<f8", (3,))])
    table["node"], table["value"] = ids, values
    file.write(table.tobytes())


def calculix(folder: Path, mesh, forces, modes, output="NODE FILE") -> Path:
    """The .frd of CalculiX for a mesh of one material, nodes held one by one, rigid elements as equations u = U + θ × r."""
    material = mesh.materials[1]
    held = {(int(mesh.node_ids[n]), c + 1) for n, c in mesh.fixed if c < 3}
    turn = int(mesh.node_ids.max())
    lines = ["*NODE"]
    lines += [f"{i},{x:.12g},{y:.12g},{z:.12g}" for i, (x, y, z) in zip(mesh.node_ids, mesh.position, strict=True)]
    equations: list[str] = []
    for k, rigid in enumerate(mesh.rigid, start=1):
        centre = int(mesh.node_ids[rigid.reference])
        if all((centre, c) in held for c in (1, 2, 3)):
            held |= {(int(mesh.node_ids[n]), c) for n in rigid.nodes for c in (1, 2, 3)}
            continue
        lines.append(f"{turn + k},0,0,0")
        for n in rigid.nodes:
            x, y, z = mesh.position[n] - mesh.position[rigid.reference]
            for c, arm in enumerate(((0, z, -y), (-z, 0, x), (y, -x, 0)), start=1):
                terms = [(mesh.node_ids[n], c, 1.0), (centre, c, -1.0)]
                terms += [(turn + k, i, -a) for i, a in enumerate(arm, start=1) if a]
                equations += [str(len(terms)), ",".join(f"{node},{i},{value:.12g}" for node, i, value in terms)]
    for block in mesh.blocks:
        lines.append(f"*ELEMENT,TYPE={ABAQUS[block.kind]},ELSET=ALL")
        for e, n in zip(block.ids, mesh.node_ids[block.nodes], strict=True):
            named = [str(e), *map(str, n)]
            lines += [",".join(named[:11]) + "," * (len(named) > 11), *([",".join(named[11:])] * (len(named) > 11))]
    lines += ["*MATERIAL,NAME=STEEL", "*ELASTIC", f"{material.youngs_modulus},{material.poisson_ratio}"]
    lines += ["*DENSITY", f"{material.density}", "*SOLID SECTION,ELSET=ALL,MATERIAL=STEEL"]
    lines += ["*BOUNDARY", *(f"{node},{c}" for node, c in sorted(held))]
    lines += ["*EQUATION", *equations] * bool(equations)
    for own in forces:
        lines += ["*STEP", "*STATIC", "*CLOAD,OP=NEW"]
        lines += [f"{node},{c},{f}" for node, force in own for c, f in enumerate(force, start=1) if f]
        lines += [f"*{output}", "U", "*END STEP"]
    lines += ["*STEP", "*FREQUENCY", str(modes), f"*{output}", "U", "*END STEP", ""]
    (folder / "model.inp").write_text("\n".join(lines))
    subprocess.run(["ccx", "model"], cwd=folder, check=True, stdout=subprocess.DEVNULL, timeout=900)
    return folder / "model.frd"
