"""Sound files to begin with: made by the writers of the other tests, and those that lie in the project."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from scipy import sparse

ROOT = Path(__file__).parents[2]
NASTRAN = """\
SOL 101
CEND
SPC = 3
MPC = 3
SET 9 = 1, 2, 3 THRU 4
BEGIN BULK
CORD2R,7,,1.,2.,3.,2.,2.,3.
+,1.,3.,3.
CORD2C  6               1.      2.      3.      1.      2.      4.
        2.      2.      3.
GRID,1,,0.,0.,0.
GRID,2,7,1.,0.,0.,6
GRID    3               0.      1.      0.
GRID*   4                               0.              0.
*       1.
GRID,50,,1.,4.,5.
GRID,51,,1.,4.,6.
CTETRA,10,1,1,2,3,4
PSOLID,1,1,7
MAT1,1,2.1+11,,.3,7850.
SPC1,1,123,1,THRU,3
SPC,2,1,123,0.
SPCADD,3,1,2
RBE2,99,50,123456,4
RBE3,98,,51,123456,1.,123,1,2,+
+,3
RBAR,97,50,32,1236,45
RROD,93,31,1,1
RBE1,92,50,123456
+,UM,31,2
MPC,3,30,1,1.,31,1,-1.
,,50,5,.1
CONM2,60,50,,2.5,0.,0.,0.
+,1.,0.,1.,0.,0.,1.
FORCE,4,50,7,10.,0.,0.,1.
MOMENT,4,50,,10.,0.,0.,1.
PLOAD4,5,10,1.,2.,3.,,1,4
PLOAD2,5,2.,71
GRAV,7,,9.81,0.,0.,-1.
RFORCE,8,3,,.5,0.,0.,1.
LOAD,9,1.,1.,5,2.,7
CELAS2,96,10.,3,1
CELAS1,94,8,4,2,3,2
PELAS,8,20.
CBUSH,95,9,2,4
PBUSH,9,K,1.
SET1,5,1,2,THRU,4,EXCEPT,3
SET3,6,ELEM,10
CQUAD4,70,1,1,2,3,4
CTRIA3,71,1,1,2,3
GRID,30,,5.,0.,0.
GRID,31,,6.,0.,0.
GRID,32,,6.,1.,0.
GRID,33,,5.,1.,0.
CQUADR,72,20,30,31,32,33,30.,.1
CTRIAR,73,20,1,2,4,7
PSHELL,20,1,.1,1,1.,1,.8,2.
CQUAD4,81,27,30,31,32,33,0,.1
PCOMP,27,-.01,1.,,,,,SYM
,28,.01,45.,YES,1,.02
CTRIA3,82,28,1,4,3,-20.
PCOMPG,28
,1,28,.01,30.,YES
,2,,,-60.
CTRIA3,83,29,1,2,4
PSHELL,29,28,.1,28,,28
MAT8,28,1.4+11,1.+10,.3,5.+9,4.+9,3.+9
,1600.
CBAR,74,21,1,2,0.,0.,1.,GGG
,56,4,.1,.1,.1
PBAR,21,1,.1,.2,.3,.4,1.
,.1,.1
,.8,.8,.1
CBEAM,75,22,1,4,2
PBEAM,22,1,.1,.2,.3,.01,.4,1.
,.1,.1
,YES,1.,.2
,.1,.2
,.8,.8
CBAR,79,25,1,3,0.,0.,1.
PBARL,25,1,,BOX
,.1,.2,.01,.01,.5
CBEAM,80,26,1,4,0.,1.,0.
PBEAML,26,1,,TUBE
,.1,.05,.5,NO,1.,.2,.1,.6
CROD,76,23,2,4
PROD,23,1,.1,.2
CTUBE,77,24,3,4
PTUBE,24,1,.2,.05
CONROD,78,1,4,1,.1
INCLUDE 'beside.inc'
ENDDATA
"""
ABAQUS = """\
*HEADING
 two parts
*PART, NAME=P
*NODE, NSET=NALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, 0., 0., 1.
*ELEMENT, TYPE=C3D4, ELSET=EALL
10, 1, 2, 3, 4
*NSET, NSET=FOOT, GENERATE
1, 3, 1
*NSET, NSET=TOP
4,
*ELSET, ELSET=E, GENERATE
10, 10, 1
*SURFACE, NAME=S, TYPE=ELEMENT
EALL, S1
*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL
*ELEMENT, TYPE=S3, ELSET=SKIN
11, 1, 2, 3
*ORIENTATION, NAME=O
1., 1., 0., -1., 1., 0.
3, 0.
*SHELL SECTION, ELSET=SKIN, COMPOSITE, SYMMETRIC, ORIENTATION=O, OFFSET=SPOS
.01, 3, Carbon, 45.
.02, , STEEL
*END PART
*ASSEMBLY, NAME=A
*INSTANCE, NAME=I, PART=P
1., 2., 3.
0., 0., 0., 0., 0., 1., 30.
*END INSTANCE
*INSTANCE, NAME=J, PART=P
5., 2., 3.
*END INSTANCE
*NODE
100, 1., 1., 9.
101, 1., 1., 8.
*NSET, NSET=REF
100
*ELEMENT, TYPE=SPRINGA, ELSET=SP
90, 100, 101
*SPRING, ELSET=SP

5.
*NSET, NSET=F, INSTANCE=I
FOOT,
*TIE, NAME=T
I.S, J.S
*RIGID BODY, REF NODE=101, PIN NSET=I.TOP
*COUPLING, CONSTRAINT NAME=C, REF NODE=100, SURFACE=J.S
*KINEMATIC
1, 3
*EQUATION
2
J.4, 1, 1., J.2, 1, -1.
*END ASSEMBLY
*MATERIAL, NAME=Steel
*ELASTIC, TYPE=ISOTROPIC
2.1e11, .3
*DENSITY
7850.,
*MATERIAL, NAME=Carbon
*ELASTIC, TYPE=LAMINA
1.4e11, 1.e10, .3, 5.e9, 4.e9, 3.e9
*DENSITY
1600.,
*BOUNDARY
F, 1, 3
*INCLUDE, INPUT=beside.inp
*STEP
*CLOAD
100, 3, 10.
*DLOAD
I.EALL, P1, 1.
, GRAV, 9.81, 0., 0., -1.
J.EALL, CENTRIF, 4., 0., 0., 0., 0., 0., 1.
*DSLOAD
I.S, P, 2.
*END STEP
"""
SUITE = """\
kind: suite
name: own
title: Two runs
suffix: -s
set: {seed: 3}
runs:
  - {config: placement.yaml, label: first, name: one, until: observe}
  - config: placement.yaml
    label: second
    set: {damping.ratio: 0.02, place: {keep: 3, estimate: [E], instants: 20}}
"""
TABLES = {
    "plain.csv": "time [s],a [um/m],F [N]\n" + "".join(f"{k * 1e-3:.3f},{k},{k * k}\n" for k in range(40)),
    "excel.csv": "sep=;\r\n# rig 3\r\ntime;a;F\r\nms;um/m;kN\r\n"
    + "".join(f"{k},5;{k},25;-1,5\r\n" for k in range(40)),
    "tabs.tsv": 'time\t"a"\t"F"\n' + "".join(f"{k / 64}\t{'' if k == 3 else k}\t{k}e3\n" for k in range(40)),
}
TETRAHEDRA = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])
MESHIO = ("part.vtu", "text.vtu", "raw.vtu", "part.vtk", "text.vtk", "part.xdmf", "part.med", "part.h5m", "part.mesh")
MESHIO += ("part.vol", "part.su2", "part.avs", "part.cgns", "part.node", "part.f3grid")


def write_seeds(folder: Path) -> None:
    """One folder a group: config, deck, measurement, results; beside the files stand those that they take in (`beside*`)."""
    groups = {"config": _configs, "deck": _decks, "measurement": _measurements, "results": _results}
    for group, write in groups.items():
        (folder / group).mkdir(parents=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            write(folder / group)


def _configs(folder: Path) -> None:
    paths = [*ROOT.glob("configs/*.yaml"), *ROOT.glob("configs/hub/*-density.yaml"), *ROOT.glob("configs/bench/*.yaml")]
    for path in sorted(paths):
        if path.name != "suite.yaml":
            (folder / path.name).write_text(path.read_text("utf-8"), "utf-8")
    (folder / "placement.yaml").write_text(
        (ROOT / "configs/cantilever-youngs-modulus.yaml").read_text("utf-8"), "utf-8"
    )
    (folder / "own-suite.yaml").write_text(SUITE, "utf-8")
    from ..robustness.small import BENCH, PLACEMENT

    (folder / "beam.yaml").write_text(PLACEMENT, "utf-8")
    (folder / "beam-bench.yaml").write_text(BENCH, "utf-8")


def _decks(folder: Path) -> None:
    import meshio

    from ..decks import test_same_model as same

    (folder / "own.bdf").write_text(NASTRAN)
    (folder / "beside.inc").write_text("GRID,60,,5.,5.,5.\n")
    (folder / "own.inp").write_text(ABAQUS)
    (folder / "beside.inp").write_text("*NSET, NSET=MORE\n100\n")
    same.nastran(folder / "many.bdf")
    same.abaqus(folder / "many.inp")
    for name, binary in (("old.msh", False), ("oldb.msh", True)):
        same.gmsh_2(folder / name, binary)
    same.grid(folder / "many.vtu")
    same.grid(folder / "many.vtk", False)
    for path in sorted((ROOT / "tests/decks/data").glob("pin-*.msh")):
        (folder / path.name).write_bytes(path.read_bytes())
    mesh = meshio.Mesh(
        TETRAHEDRA,
        [("tetra", [[0, 1, 2, 3], [1, 2, 3, 4]]), ("triangle", [[0, 1, 2]])],
        point_data={"node_id": np.arange(1, 6), "foot": np.array([1, 1, 1, 0, 0])},
        cell_data={"region": [np.array([1, 2]), np.array([0])]},
    )
    options = {"text.vtu": {"binary": False}, "raw.vtu": {"compression": None}, "text.vtk": {"binary": False}}
    bare = meshio.Mesh(TETRAHEDRA, [("tetra", [[0, 1, 2, 3], [1, 2, 3, 4]])])
    for name in MESHIO:
        for one in (mesh, bare):
            try:
                meshio.write(folder / name, one, **options.get(name, {}))
                break
            except (Exception, SystemExit):  # a format that cannot hold the data
                (folder / name).unlink(missing_ok=True)
    _matrices(folder)


def _matrices(folder: Path) -> None:
    from scipy.io import mmwrite

    from ..foreign.matrices.test_op4 import write

    A = sparse.random_array((9, 9), density=0.3, rng=np.random.default_rng(0), format="csr")
    A = sparse.csr_array(A + A.T)
    for layout in ("dense", "bigmat", "nonbigmat"):
        for binary in (False, True):
            write(folder / f"{layout}{'b' * binary}.op4", {"k": A.toarray()}, binary=binary, sparse=layout, digits=16)
    mmwrite(folder / "k.mtx", sparse.coo_array(A), symmetry="symmetric")
    mmwrite(folder / "full.mtx", A.toarray())
    sparse.save_npz(folder / "k.npz", A, compressed=False)
    np.savez_compressed(folder / "full.npz", k=A.toarray())
    (folder / "rows.csv").write_text("node,component\n" + "".join(f"{n},{c}\n" for n in range(1, 4) for c in (1, 2, 3)))


def _measurements(folder: Path) -> None:
    import h5py

    from ..measurements import test_uff58 as uff

    for name, text in TABLES.items():
        (folder / name).write_text(text, newline="")
    values, uneven = uff.A[:24], np.arange(24) + 0.01 * uff.A[:24]
    universal = {
        "text.uff": uff.UNITS_SI + uff.NODES + uff.text(values) + uff.text(values, node=13, data=4, unit="um/m"),
        "uneven.uff": uff.text(values, even=0, time=uneven, step=0.0, time_label="ms"),
        "binary.uff": uff.binary(values, data=4) + uff.binary(values, order=">", node=13),
        "binary-uneven.uff": uff.binary(values, time=uneven, data=4),
    }
    for name, content in universal.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode("cp1252"))
    for name, more in {"plain.h5": {}, "packed.h5": {"chunks": (8,), "compression": "gzip", "shuffle": True}}.items():
        with h5py.File(folder / name, "w") as file:
            file.create_dataset("time", data=np.arange(24) * 1e-3, **more).attrs["units"] = "s"
            file.create_dataset("a", data=np.arange(24.0), **more).attrs["units"] = "um/m"
            file.create_dataset("group/table", data=np.arange(48.0, dtype="f4").reshape(24, 2))
            file["link"] = h5py.SoftLink("/group/table")


def _results(folder: Path) -> None:
    from ..foreign.results import test_op2, test_punch, test_universal

    for name, w in {"own.op2": test_op2.Writer(), "long.op2": test_op2.Writer(">", 8)}.items():
        (folder / name).write_bytes(w.file(w.lama([(1, 4e4, 2.5)]), w.modes(), w.static(3)))
    rows = test_punch.rows()
    test_punch.written(folder, test_punch.mode(1, 4e4), rows, test_punch.comments("DISPLACEMENTS"), rows)
    test_universal.written(folder, test_universal.dataset55(), test_universal.dataset2414(analysis=9), name="own.unv")
    (folder / "own.frd").write_bytes((ROOT / "tests/foreign/results/data/column.frd").read_bytes())
