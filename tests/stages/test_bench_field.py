"""The field of a bench's body as ParaView reads it: a cantilever's displacement and stress, a body that moves, moduli."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import pyvista
from vtkmodules.vtkIOHDF import vtkHDFReader

from strainsight.cases.bench.surface_field import Motion, instants, points
from strainsight.cases.bench.surface_field import pictures as field_of
from strainsight.cases.resources import silent
from strainsight.config.bench.bench import SurfaceField
from strainsight.config.load import load_config
from strainsight.records.bodies import ReducedBodies
from strainsight.records.mesh import Meshes
from strainsight.records.record import read
from strainsight.sweep.sweep import serial

from ..models import project
from .test_bench_place import BEAM, HEIGHT, LENGTH, MODULUS, WIDTH, run

SIDE, DOWN = 1000.0, 500.0
AROUND_Z, AROUND_Y = HEIGHT * WIDTH**3 / 12, WIDTH * HEIGHT**3 / 12


FREE = f"bodies.beam.moduli={{E: {{region: 1, value: {MODULUS:e}}}}}"


@pytest.fixture(scope="module")
def beam():
    """The loaded beam, without gauges, its modulus free: its config, and stage → artefact."""
    settings = ("sensors={}", "place=null", "estimate=null", FREE)
    return load_config(project(BEAM), settings).model, run(*settings, only=("import", "reduce", "simulate", "field"))


@pytest.fixture(scope="module")
def field(beam):
    return beam[1]["field"]


@pytest.fixture(scope="module")
def pictures(field):
    """Every step as vtkHDFReader gives it."""
    reader = vtkHDFReader()
    reader.SetFileName(str(field.path))
    reader.UpdateInformation()
    found = []
    for step in range(reader.GetNumberOfSteps()):
        reader.SetStep(step)
        reader.Update()
        found.append(pyvista.wrap(reader.GetOutput()).copy())
    return found


def test_there_is_a_picture_an_instant_with_units_and_the_summary_has_the_largest_stress(field, pictures):
    assert len(pictures) == 3
    np.testing.assert_allclose(field["/time"], [0.0, 0.02, 0.05])
    np.testing.assert_allclose(field["/VTKHDF/Steps/Values"], field["/time"])
    assert field.attributes("/VTKHDF/CellData/stress")["units"] == "Pa"
    assert field.attributes("/VTKHDF/PointData/displacement")["units"] == "m"
    assert all(grid.n_cells == field.summary["facets"] for grid in pictures)
    worst = max(float(grid.cell_data["von_mises"].max()) for grid in pictures)
    assert field.summary["von_mises"] == pytest.approx(worst, rel=1e-6)


def test_the_tip_of_a_cantilever_goes_where_the_beam_formula_says(pictures):
    """F L³/3EI and the shear F L/κGA, κ = 5/6: the mesh holds its ends against warping, 1 %."""
    G, A = MODULUS / 2.6, WIDTH * HEIGHT
    grid = pictures[0]
    tip = np.abs(grid.points[:, 0] - LENGTH) < 1e-9
    moved = grid.point_data["displacement"][tip].mean(axis=0)
    for load, second, found in ((SIDE, AROUND_Z, moved[1]), (DOWN, AROUND_Y, moved[2])):
        assert found == pytest.approx(
            load * LENGTH**3 / (3 * MODULUS * second) + load * LENGTH / (5 / 6 * G * A), rel=0.01
        )


def test_stress_and_strain_are_those_of_bending(pictures):
    """σ = −(L − x)(F_y y/I_z + F_z z/I_y) away from the ends, E ε beside it, and von Mises the same where nothing else pulls."""
    for grid in pictures:  # at rest all along
        centre = grid.cell_centers().points
        lateral = (np.abs(np.abs(centre[:, 1]) - WIDTH / 2) < 1e-9) | (np.abs(np.abs(centre[:, 2]) - HEIGHT / 2) < 1e-9)
        own = lateral & (np.abs(centre[:, 0] - LENGTH / 2) < 0.6)
        expected = -(LENGTH - centre[own, 0]) * (SIDE * centre[own, 1] / AROUND_Z + DOWN * centre[own, 2] / AROUND_Y)
        largest = np.abs(expected).max()
        np.testing.assert_allclose(grid.cell_data["stress"][own, 0], expected, atol=0.01 * largest)
        np.testing.assert_allclose(grid.cell_data["strain"][own, 0] * MODULUS, expected, atol=0.01 * largest)
        strong = np.abs(expected) > 0.5 * largest
        np.testing.assert_allclose(grid.cell_data["von_mises"][own][strong], np.abs(expected)[strong], rtol=0.02)


def test_points_of_a_body_that_moves_go_with_it():
    """p = r + R(x + Φη), a quarter turn about z; the motion is from where the grid has the point."""
    x = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.5]])
    shapes = np.zeros((2, 3, 1))
    shapes[1, 2, 0] = 0.1
    R = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    q = np.concatenate([[5.0, 6.0, 7.0], R.T.ravel(), [3.0]])[None]
    found = points(x, shapes, q, 1)
    np.testing.assert_allclose(found["displacement"], [[[0, 0, 0], [0, 0, 0.3]]], atol=1e-7)
    np.testing.assert_allclose(found["motion"] + x, [[[5, 7, 7], [3, 6, 7.8]]], atol=1e-6)


def test_an_estimated_modulus_scales_the_stress_of_its_instant(beam):
    """One shape held twice, the second time by a body a tenth stiffer; what was not estimated is as in the config."""
    config, done = beam
    mesh, reduced = read(Meshes, done["import"]).bodies["beam"], read(ReducedBodies, done["reduce"]).bodies["beam"]
    time, q = np.array([0.0, 1.0]), np.tile(done["simulate"]["/q"][0], (2, 1))
    alone = SimpleNamespace(files={}, progress=silent, sweep=serial)
    found = field_of(config, mesh, reduced, Motion(time, q, {"E": MODULUS * np.array([1.0, 1.1])}), alone).found
    assert found.von_mises[1] == pytest.approx(1.1 * found.von_mises[0], rel=1e-6)
    plain = field_of(config, mesh, reduced, Motion(time, q, {}), alone).found
    np.testing.assert_array_equal(plain.moduli["E"], [MODULUS, MODULUS])
    np.testing.assert_allclose(plain.von_mises, found.von_mises[0], rtol=1e-6)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"every": 4, "instants": None}, [0, 4, 8]),
        ({"every": None, "instants": 3}, [0, 5, 10]),
        ({"every": None, "instants": None}, list(range(11))),
    ],
)
def test_pictures_are_evenly_in_time(settings, expected):
    assert instants(11, SurfaceField(body="hub", **settings)).tolist() == expected
