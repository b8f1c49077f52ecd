"""Results of CalculiX, Ansys and VTK files; damaged ones are refused."""

from __future__ import annotations

import gzip
import math
import sys
from pathlib import Path
from types import SimpleNamespace

import meshio
import numpy as np
import pytest

from strainsight.decks.other.load import load
from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError
from strainsight.fem.checks import check_geometry
from strainsight.foreign.results import ansys, reader
from strainsight.foreign.results.reader import read_responses

from ...bodies import body
from ...frd import Found, write_frd
from ...refusals import expect_refusal

COLUMN = Path(__file__).parent / "data" / "column.frd"
"""A column of two cubes of 1 m, clamped below; steps 1 and 2: 1 N along x and y on node 11 of its top; step 3: three modes."""


def test_frd_results_are_read():
    found = list(read_responses(COLUMN))
    assert [(own.kind, own.step, own.number) for own in found] == [
        ("static", 1, 1), ("static", 2, 1), ("mode", 3, 1), ("mode", 3, 2), ("mode", 3, 3),
    ]
    assert all(own.node_ids.tolist() == list(range(1, 13)) and own.motion.shape == (12, 3) for own in found)
    assert [own.modal_mass for own in found] == [None, None, 1.0, 1.0, 1.0]
    # its eigenvalues, as its .dat has them
    assert [(2 * math.pi * own.frequency) ** 2 for own in found[2:]] == pytest.approx(
        [1.962242e6, 1.962242e6, 6.679308e6], rel=3e-7
    )
    along_x, along_y = found[0].motion, found[1].motion
    assert along_x[10, 1] == pytest.approx(along_y[10, 0], rel=1e-6)  # Maxwell and Betti
    assert not np.any(along_x[:4])
    assert along_x[10, 0] == 1.62778e-10


def test_frd_mesh_is_read():
    mesh = read_mesh(COLUMN)
    assert {number: region.name for number, region in mesh.regions.items()} == {1: "S"}
    assert mesh.blocks[0].kind == "hex8"
    assert mesh.blocks[0].ids.tolist() == [1, 2]
    assert mesh.node_ids[mesh.blocks[0].nodes].tolist() == [list(range(1, 9)), list(range(5, 13))]
    assert mesh.position[10].tolist() == [1.0, 1.0, 2.0]


def box(u, v, w):
    return u, 1.25 * v, 1.5 * w


@pytest.mark.parametrize("kind", ["hex8", "wedge6", "tet4", "hex20", "wedge15", "tet10"])
def test_frd_solids_keep_node_order(kind, tmp_path):
    mesh = body(kind, (1, 1, 1), box)
    write_frd(tmp_path / "one.frd", mesh, motions(mesh), form=3)
    again = read_mesh(tmp_path / "one.frd")
    check_geometry(again)
    assert again.blocks[0].kind == kind
    assert np.array_equal(again.node_ids[again.blocks[0].nodes], mesh.node_ids[mesh.blocks[0].nodes])
    assert np.array_equal(again.position, mesh.position)


def motions(mesh):
    rng = np.random.default_rng(1)
    n = len(mesh.position)
    size = 10.0 ** rng.integers(-12, 3, (n, 3, 5))
    values = rng.uniform(-1, 1, (n, 3, 5)) * size
    return Found(np.array([12.3456789, 45.6789012, 789.0123]), values[:, :, 2:], values[:, :, :2])


@pytest.mark.parametrize(("form", "digits"), [(1, 5e-6), (2, 6e-8), (3, 0.0)])
def test_frd_text_and_binary_agree(form, digits, tmp_path):
    mesh = body("hex8", (1, 1, 1), box)
    wanted = motions(mesh)
    write_frd(tmp_path / "a.frd", mesh, wanted, form=form)
    (tmp_path / "b.frd.gz").write_bytes(gzip.compress((tmp_path / "a.frd").read_bytes()))
    for path in (tmp_path / "a.frd", tmp_path / "b.frd.gz"):
        found = list(read_responses(path))
        assert [own.kind for own in found] == ["static"] * 2 + ["mode"] * 3
        assert [own.frequency for own in found[2:]] == pytest.approx(wanted.frequency, rel=1e-9)
        values = np.concatenate([wanted.static, wanted.shapes], axis=2)
        for j, own in enumerate(found):
            assert np.array_equal(own.node_ids, mesh.node_ids)
            assert np.all(np.abs(own.motion - values[:, :, j]) <= digits * np.abs(values[:, :, j]))
            assert digits <= own.rounding


def test_frd_wide_number_is_read(tmp_path):
    """CalculiX writes −1.23457E-100 in 13 columns of 12."""
    text = COLUMN.read_text()
    row = next(line for line in text.splitlines() if line.startswith(" -1         9 7.69237E-11"))
    (tmp_path / "a.frd").write_text(text.replace(row, row[:13] + "-7.69237E-111" + row[25:]))
    found = next(iter(read_responses(tmp_path / "a.frd")))
    assert found.motion[8, 0] == -7.69237e-111
    assert found.motion[8, 1] == 3.69008e-11
    assert found.motion[10, 0] == 1.62778e-10


def step(kind: str):
    return lambda text: text.replace(
        "                     0    1           1", f"                     {kind}    1           1"
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text[: len(text) // 2], "truncated|does not end|cannot be read"),
        (lambda text: text.replace("7.69237E-11", "        NaN"), "finite"),
        (step("4"), "neither static nor a frequency step"),
    ],
)
def test_damaged_frd_is_refused(change, said, tmp_path):
    path = tmp_path / "a.frd"
    path.write_text(change(COLUMN.read_text()))
    with expect_refusal(DeckError, said, remedy="") as caught:
        list(read_responses(path))
    assert caught.value.where.startswith(str(path))


def test_missing_or_unknown_result_file_is_refused(tmp_path):
    with pytest.raises(DeckError, match="no such file"):
        list(read_responses(tmp_path / "a.frd"))
    with pytest.raises(DeckError, match=r"a\.dat is not a known result file"):
        list(read_responses(tmp_path / "a.dat"))


def test_one_response_at_a_time(tmp_path):
    text = COLUMN.read_text()
    second = text.index("    1PSTEP", text.index("    1PSTEP") + 1)
    (tmp_path / "a.frd").write_text(text[:second] + "  100CX")
    found = read_responses(tmp_path / "a.frd")
    assert next(found).step == 1
    with pytest.raises(DeckError):
        next(found)


# The result file that comes with ansys-mapdl-reader: modes of a free-standing block of hexahedra.
@pytest.mark.slow
def test_rst_modes_match_library():
    from ansys.mapdl.reader import examples, read_binary

    ours, theirs = list(read_responses(examples.rstfile)), read_binary(examples.rstfile)
    assert [(r.kind, r.step, r.number) for r in ours] == [("mode", 1, k) for k in range(1, 7)]
    np.testing.assert_array_equal([r.frequency for r in ours], theirs.time_values)
    for row, response in enumerate(ours):
        ids, motion = theirs.nodal_solution(row)
        np.testing.assert_array_equal(response.node_ids, ids)
        np.testing.assert_array_equal(response.motion, motion)


class Made:
    """What the library makes of a file: two load steps, and components in an order of their own."""

    def __init__(self, analysis, names=("ROTZ", "UZ", "UY", "UX", "ROTX", "ROTY", "TEMP"), cyclic=False, complex_=0):
        table = np.array([[1, 1, 1], [2, 3, 2]])
        self._resultheader = {"kan": analysis, "cpxrst": complex_, "ls_table": table, "title": " a run "}
        self._is_cyclic, self.names, self.n_results, self.time_values = cyclic, names, 2, np.array([5.0, 8.0])

    def result_dof(self, row):
        return self.names

    def nodal_solution(self, row):
        columns = {"UX": 1, "UY": 2, "UZ": 3, "ROTX": 4, "ROTY": 5, "ROTZ": 6, "TEMP": 7}
        values = np.array([[10 * node + columns[name] for name in self.names] for node in (4, 2)], dtype=float)
        return np.array([4, 2], dtype=np.int32), (row + 1) * values


def read_here(made, monkeypatch):
    library = SimpleNamespace(read_binary=lambda path: made)  # importing it takes a second
    monkeypatch.setitem(sys.modules, "ansys.mapdl.reader", library)
    return list(ansys.responses(Path("run.rst"), Path("copy.rst")))


def test_rst_static_results_have_rotations(monkeypatch):
    first, second = read_here(Made(0), monkeypatch)
    assert [(r.kind, r.step, r.number, r.frequency, r.label) for r in (first, second)] == [
        ("static", 1, 1, 0.0, "a run"),
        ("static", 2, 3, 0.0, "a run"),
    ]
    assert second.node_ids.tolist() == [4, 2]
    np.testing.assert_array_equal(second.motion, 2.0 * (np.array([[40], [20]]) + np.arange(1, 7)))
    assert read_here(Made(2, names=("UX", "UY", "UZ")), monkeypatch)[1].frequency == 8.0


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (Made(1), "a buckling analysis"),
        (Made(4), "a transient analysis"),
        (Made(2, cyclic=True), "a cyclic analysis"),
        (Made(2, complex_=1), "complex results"),
        (Made(0, names=("TEMP",)), "lacks the displacements UX, UY, UZ"),
    ],
)
def test_unsupported_rst_results_are_refused(monkeypatch, made, said):
    with expect_refusal(DeckError, said, remedy=""):
        read_here(made, monkeypatch)


def rst(folder: Path) -> Path:
    (folder / "run.rst").write_bytes(b"never read")
    return folder / "run.rst"


def test_missing_rst_library_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(ansys, "MODULE", "no_such_package.reader")
    with pytest.raises(DeckError, match="ansys-mapdl-reader, which is not installed") as caught:
        list(read_responses(rst(tmp_path)))
    assert caught.value.remedy == 'install it: pip install "strainsight[results]"'


def test_reader_crash_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(ansys, "COMMAND", [sys.executable, "-c", "print('ready', flush=True)"])
    with pytest.raises(DeckError, match="ansys-mapdl-reader crashed or took too long"):
        list(read_responses(rst(tmp_path)))


# Point data of VTU and VTK files that meshio and VTK itself write.
POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
SHAPE = np.arange(12, dtype=float).reshape(4, 3) / 7 - 1


@pytest.fixture
def here(monkeypatch):
    """Read in this process: a child process takes a second to start."""
    monkeypatch.setattr(reader, "load_sandboxed", load)


def written(tmp_path, point_data, field_data=None, name="run.vtu", **options):
    path = tmp_path / name
    data = meshio.Mesh(POINTS, [("tetra", np.array([[0, 1, 2, 3]]))], point_data=point_data, field_data=field_data or {})
    data.write(path, **options)
    return path


def with_field_data(tmp_path, point_data, frequencies):
    """By VTK: meshio writes no field data into a VTU file."""
    import pyvista

    grid = pyvista.UnstructuredGrid(np.array([4, 0, 1, 2, 3]), np.array([10], np.uint8), POINTS)
    for name, values in point_data.items():
        grid.point_data[name] = values
    grid.field_data["Frequencies"] = frequencies
    path = tmp_path / "run.vtu"
    grid.save(path)
    return path


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("name", ["run.vtu", "run.vtk"])
def test_vtu_modes_are_identified_by_name(tmp_path, name):
    data = {"GlobalNodeId": np.array([7, 5, 3, 1]), "mode_2_40.5Hz": 2 * SHAPE, "Displacement_3": SHAPE.astype("f4")}
    others = dict.fromkeys(["stress_mode_1", "mode_1_stress", "velocity"], SHAPE) | {"temperature": SHAPE[:, 0]}
    mode, displacement, u = read_responses(written(tmp_path, data | {"U": 4 * SHAPE} | others, name=name))
    assert (mode.kind, mode.step, mode.number, mode.frequency) == ("mode", 1, 2, 40.5)
    assert (displacement.kind, displacement.step, displacement.number) == ("static", 3, 1)
    assert (u.step, u.label) == (1, "U")
    assert mode.node_ids.tolist() == [7, 5, 3, 1]
    np.testing.assert_array_equal(mode.motion, 2 * SHAPE)
    np.testing.assert_array_equal(displacement.motion, SHAPE.astype("f4"))
    assert (mode.rounding, displacement.rounding) == (2e-16, 6e-8)


@pytest.mark.usefixtures("here")
def test_names_with_blanks_rotations_and_frequencies_as_field_data(tmp_path):
    six = np.hstack([SHAPE, -SHAPE])
    path = with_field_data(tmp_path, {"Mode 2": six, "eigenvector1": SHAPE, "Mode 3 (9.5 Hz)": SHAPE}, [1.5, 2.5])
    found = {r.number: r for r in read_responses(path)}
    assert {number: r.frequency for number, r in found.items()} == {1: 1.5, 2: 2.5, 3: 9.5}
    np.testing.assert_array_equal(found[2].motion, six)
    assert found[2].node_ids.tolist() == [1, 2, 3, 4]


@pytest.mark.usefixtures("here")
def test_a_mode_without_frequency_is_refused(tmp_path):
    with expect_refusal(DeckError, "mode 1 has no frequency", remedy='"mode_1 12.5 Hz"'):
        list(read_responses(written(tmp_path, {"mode_1": SHAPE})))
    with pytest.raises(DeckError, match="mode 3 has no frequency"):
        list(read_responses(with_field_data(tmp_path, {"mode_3": SHAPE}, [1.5, 2.5])))


@pytest.mark.usefixtures("here")
def test_damaged_files_are_refused(tmp_path):
    with pytest.raises(DeckError, match=r"the motion of node 3 is not finite: -0\.142857,"):
        list(read_responses(written(tmp_path, {"U": np.where(SHAPE[2, 1] == SHAPE, np.nan, SHAPE)})))
    path = written(tmp_path, {"U": SHAPE})
    path.write_bytes(path.read_bytes()[:400])
    with pytest.raises(DeckError, match="cannot be read as vtu"):
        list(read_responses(path))
