"""Point data of VTU and VTK files that meshio and VTK itself write."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

from strainsight.decks.other.load import load
from strainsight.decks.results import vtu
from strainsight.decks.results.reader import read_responses
from strainsight.errors import DeckError

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
SHAPE = np.arange(12, dtype=float).reshape(4, 3) / 7 - 1


@pytest.fixture
def here(monkeypatch):
    """Read in this process: a child process takes a second to start."""
    monkeypatch.setattr(vtu, "load_sandboxed", load)


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


@pytest.mark.parametrize("name", ["run.vtu", "run.vtk"])
def test_modes_and_displacements_by_their_names(tmp_path, name):
    path = written(
        tmp_path,
        {
            "GlobalNodeId": np.array([7, 5, 3, 1]),
            "mode_2_40.5Hz": 2 * SHAPE,
            "Displacement_3": SHAPE.astype("f4"),
            "U": 4 * SHAPE,
            "stress_mode_1": SHAPE,
            "mode_1_stress": SHAPE,
            "temperature": SHAPE[:, 0],
            "velocity": SHAPE,
        },
        name=name,
    )
    mode, displacement, u = read_responses(path)
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
    with pytest.raises(DeckError, match="mode 1 has no frequency") as caught:
        list(read_responses(written(tmp_path, {"mode_1": SHAPE})))
    assert '"mode_1 12.5 Hz"' in caught.value.remedy
    with pytest.raises(DeckError, match="mode 3 has no frequency"):
        list(read_responses(with_field_data(tmp_path, {"mode_3": SHAPE}, [1.5, 2.5])))
    with pytest.raises(DeckError, match="the frequency of the mode is nan"):
        list(read_responses(with_field_data(tmp_path, {"mode_1": SHAPE}, [np.nan])))


def test_damaged_files_are_refused(tmp_path):
    motion = SHAPE.copy()
    motion[2, 1] = np.nan
    with pytest.raises(DeckError, match="node 3 moves by"):
        list(read_responses(written(tmp_path, {"U": motion})))
    path = written(tmp_path, {"U": SHAPE})
    path.write_bytes(path.read_bytes()[:400])
    with pytest.raises(DeckError, match="cannot be read as vtu"):
        list(read_responses(path))
