"""Records of data classes, meshes and bodies come back as they were."""

from __future__ import annotations

import pickle
from dataclasses import fields

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.errors import ArtefactError
from strainsight.fem.affine import AffineOperator, Coefficient, Newton
from strainsight.mesh.model import Mesh
from strainsight.mesh.thin_faces import with_faces, with_sides
from strainsight.records.bench import ReducedBodies, ReducedBody
from strainsight.records.mesh import MeshColumns, mesh_from
from strainsight.records.record import FieldPlace, dataset, group, read, record, written
from strainsight.rom.inertia import InertiaInvariants
from strainsight.runner.artefact import Artefact, ArtefactHeader
from strainsight.runner.output import Dataset, Output
from strainsight.runner.store import write_artefact


@record
class Body:
    mass: float = dataset("kg", "", "its mass")
    names: tuple[str, ...] = dataset("1", "frame", "its frames")


@record
class Run:
    time: np.ndarray = dataset("s", "/time", "time")
    strain: np.ndarray = dataset("strain", "/time × channel", "readings")
    direction: np.ndarray = dataset("1", "channel × 3", "directions")
    noise: np.ndarray | None = dataset("unit of the channel", "channel", "its noise", default=None)
    estimate: dict[str, np.ndarray] = dataset("unit of <name>", "/time", "estimate of <name>")
    bodies: dict[str, Body] = group()
    first: Body = group()
    bonded: np.ndarray | None = dataset("m", "bonded", "distance", path="/glued", default=None)


def run_of(**changes) -> Run:
    given = {
        "time": np.arange(4.0),
        "strain": np.ones((4, 2)),
        "direction": np.eye(3)[:2],
        "estimate": {"E": np.full(4, 2e11), "tip": np.zeros(4)},
        "bodies": {"hub": Body(mass=3.5, names=("a", "b")), "blade": Body(mass=1.0, names=())},
        "first": Body(mass=2.0, names=("c",)),
    }
    return Run(**(given | changes))


UNITS = {"E": "Pa", "tip": "N"}


def stored(folder, datasets) -> Artefact:
    return write_artefact(folder / "toy.h5", Output(datasets, {}, "toy"), ArtefactHeader("toy", 1, "key", {}, {}, {}))


def test_record_roundtrip(tmp_path):
    run = run_of()
    found = read(Run, stored(tmp_path, written(run, UNITS)))
    assert isinstance(found, Run)
    for name in ("time", "strain", "direction"):
        np.testing.assert_array_equal(getattr(found, name), getattr(run, name))
    assert list(found.estimate) == ["E", "tip"]
    np.testing.assert_array_equal(found.estimate["E"], run.estimate["E"])
    assert {name: (body.mass, body.names) for name, body in found.bodies.items()} == {
        "hub": (3.5, ("a", "b")),
        "blade": (1.0, ()),
    }
    assert found.first.mass == 2.0
    assert found.bonded is None


def test_units_names_and_labels_of_axes_are_those_of_the_fields():
    datasets = written(run_of(), UNITS)
    assert datasets["/estimate/E"].unit == "Pa"
    assert datasets["/estimate/tip"].description == "estimate of tip"
    assert datasets["/strain"].scales == ("/time", "")
    assert datasets["/time"].scales == ()
    assert "/glued" not in datasets


def test_inconsistent_lengths_are_not_written():
    with pytest.raises(ValueError, match=r"/strain has length 3 along the axis '/time', but /time has 4"):
        written(run_of(strain=np.ones((3, 2))), UNITS)
    with pytest.raises(ValueError, match=r"/direction has length 2 along the axis '3', but its definition has 3"):
        written(run_of(direction=np.ones((2, 2))), UNITS)
    with pytest.raises(ValueError, match=r"/strain has the shape \(4,\) instead of \("):
        written(run_of(strain=np.ones(4)), UNITS)
    with pytest.raises(ValueError, match="/time of Run is missing"):
        written(run_of(time=None), UNITS)


def test_inconsistent_lengths_in_file_are_reported_on_reading(tmp_path):
    datasets = written(run_of(), UNITS) | {"/direction": Dataset(np.eye(3), "1", "one too many")}
    found = read(Run, stored(tmp_path, datasets))
    assert found.strain.shape == (4, 2)
    with pytest.raises(ArtefactError, match="/direction has length 3 along the axis 'channel', but /strain has 2"):
        _ = found.direction


def test_read_record_can_be_pickled(tmp_path):
    found = pickle.loads(pickle.dumps(read(Run, stored(tmp_path, written(run_of(), UNITS)))))
    (tmp_path / "toy.h5").unlink()
    assert type(found) is Run
    assert found.bodies["hub"].names == ("a", "b")
    np.testing.assert_array_equal(found.strain, np.ones((4, 2)))


DECK = """\
BEGIN BULK
CORD2R,5,0,0.,0.,0.,0.,0.,1.
,0.,1.,0.
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,0.,1.,0.
GRID,4,,0.,0.,1.
GRID,5,,1.,1.,1.,5
GRID,6,,2.,2.,2.
CTETRA,7,3,1,2,3,4
CTETRA,8,3,5,2,3,4
CQUAD4,11,4,1,2,6,3,30.,.1
CTRIA3,12,5,1,2,3
CBAR,13,7,2,3,0.,0.,1.
,456,5,.1,.2,.3
CBEAM,14,8,1,6,0.,1.,0.
CONROD,15,3,4,9,.2,.3,,.5
PSHELL,4,9,.2,9,,9,,2.
PSHELL,5,9,.3,9
PBAR,7,9,.1,.2,.3,.4,.5
,.1,.2,.3,.4
PBEAM,8,9,.1,.2,.3,.01,.4,.5
,.1,.2,.3,.4
,YES,1.,.2,.3,.4,.02,.5,.6
,.5,.6
PSOLID,3,9
MAT1,9,2.1E11,,0.3,7850.
RBE2,20,6,123,2,3
RBE3,30,,5,123456,1.,12,3,4
,2.,46,1
MPC,50,3,1,1.,6,5,-.1
,,4,2,3.
MPC,50,4,3,1.
CONM2,40,6,,2.5,.1,.2,.3
,1.,.0,2.,.0,.0,3.
CTRIA3,90,9,1,2,3,30.
PCOMP,9,,.5,,,,,SYM
,10,.1,30.,,9,.2
MAT8,10,1.4+11,1.+10,.3,5.+9,,3.+9,1600.
CTETRA,92,12,1,2,3,5
PSOLID,12,14,5
MAT11,14,1.4+11,1.+10,1.+10,.3,.3,.4,5.+9
,5.+9,3.4+9,1600.
CTRIA3,91,13,2,3,6
PSHELL,13,9,.2,15,,15
MAT1,15,7.+10,,.3
CMASS2,41,2.5,4,2
SPC1,1,123,1
FORCE,7,2,,100.,0.,0.,1.
ENDDATA
"""


def same(a, b) -> bool:
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(same, a, b))
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b)


def test_mesh_roundtrip(tmp_path):
    below = "/bodies/hub"
    (tmp_path / "own.bdf").write_text(DECK)
    mesh = with_sides(with_faces(read_mesh(tmp_path / "own.bdf", "mm", "t")))
    datasets = written(MeshColumns.of(mesh), at=FieldPlace(below))
    output = Output(datasets, {}, "toy")
    found = mesh_from(write_artefact(tmp_path / "import.h5", output, ArtefactHeader("import", 1, "key", {}, {}, {})), below)
    assert (
        len(mesh.rigid) == len(mesh.averaging) == len(mesh.point_masses) - 1 == len(mesh.loads) == len(mesh.axes) == 1
    )
    assert [len(own.value) for own in mesh.relations] == [3, 1]
    assert len(mesh.shells) == len(mesh.beams) == 2
    assert len(mesh.sections) == 7
    assert len(mesh.laminae) == len(mesh.anisotropic) == len(mesh.orientations) == 1
    assert len(mesh.arms) == 2 * (4 + 3 + 3 + 3) + 16  # a shell has two faces, a beam without pins four sides
    for field in fields(Mesh):
        if field.name not in ("source", "included", "origin", "read"):  # of the deck, not of the model
            own, there = getattr(mesh, field.name), getattr(found, field.name)
            assert same(own, there), field.name


def test_reduced_body_roundtrip(tmp_path):
    rng = np.random.default_rng(0)
    inertia = InertiaInvariants(
        2.0, rng.random(3), rng.random((3, 2)), np.eye(3), rng.random((2, 3, 3)), rng.random((2, 2, 3, 3)),
        rng.random((3, 3, 2)), rng.random((2, 3, 3, 2)), np.eye(2),
    )  # fmt: skip
    thickness = Newton("t", (1.5, 0.0), 0.5, (1.0, 2.0), 0.1, True)
    own = ReducedBody(
        clamped=True,
        frequency=np.array([1.0]),
        cut=5.0,
        reach={"E": np.array([1.0, 4.0])},
        mass=np.diag([1.0, 3.0]),
        stiffness=AffineOperator(
            np.diag([1.0, 2.0]),
            {"E": np.diag([3.0, 4.0]), "E t": np.eye(2)},
            {"E t": Coefficient((Newton("E"), thickness), np.arange(6.0).reshape(2, 3))},
        ),
        damping=AffineOperator(np.eye(2), {}),
        basis=np.eye(6, 2),
        interface={"12": 2 * np.eye(6, 2), "7": np.eye(6, 2)},
        inertia=inertia,
    )
    datasets = written(ReducedBodies(bodies={"b": own}))
    artefact = write_artefact(
        tmp_path / "reduce.h5", Output(datasets, {}, "toy"), ArtefactHeader("reduce", 1, "key", {}, {}, {})
    )
    found = read(ReducedBodies, artefact).bodies["b"]
    assert found.stiffness.coefficients["E t"].bases == own.stiffness.coefficients["E t"].bases
    for t in (0.5, 1.5, 4.0):
        np.testing.assert_array_equal(*(X.stiffness.at({"E": 2.0, "t": t}) for X in (found, own)))
    for field in fields(ReducedBody):
        if field.name not in ("stiffness", "damping"):
            assert same(getattr(found, field.name), getattr(own, field.name)), field.name
    np.testing.assert_array_equal(found.damping.at({"E": 2.0}), np.eye(2))
