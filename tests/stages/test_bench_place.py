"""Gauges placed on the body of a bench: a beam's formula, the sensor they become, and the field of the body in ParaView."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista
from vtkmodules.vtkIOHDF import vtkHDFReader

from strainsight.config.bench.bench import SurfaceField
from strainsight.config.load import load_config
from strainsight.errors import StrainsightError
from strainsight.experiment.bench.reduction import BodyMotion, field_output, instants, points
from strainsight.experiment.system import silent
from strainsight.parallel import serial
from strainsight.records.bench import ReducedBodies
from strainsight.records.mesh import Meshes
from strainsight.records.record import read

from ..edges.beam import BENCH_CONFIG, bricks
from ..edges.beam import finished as small
from ..models import artefacts, project
from .conftest import ROOT, job_of
from .test_artefacts import assert_summary_is_listed

LENGTH, WIDTH, HEIGHT, MODULUS = 2.0, 0.25, 0.19, 2.1e11
NOISE = 1e-7
BEAM = f"""
kind: bench
name: beam
bodies:
  beam: {{type: flexible, mesh: {{file: {ROOT}/meshes/cantilever-coarse.bdf}}, modes: 4, damping: {{type: modal, ratio: 0.01}}}}
frames:
  tip: {{body: beam, node: 2}}
forces:
  side: {{type: force, frame: tip, direction: [0, 1, 0], signal: {{type: constant, value: 1000.0}}}}
  down: {{type: force, frame: tip, direction: [0, 0, 1], signal: {{type: constant, value: 500.0}}}}
sensors:
  gauges: {{type: strain, body: beam, layout: place}}
  others: {{type: strain, body: beam, layout: random}}
simulate: {{duration: 0.05, time_step: 0.01}}
estimate:
  sensors: {{gauges: {{noise: {NOISE}}}}}
  inputs:
    side: {{std: 1.0e+3, increment: 20.0}}
    down: {{std: 1.0e+3, increment: 10.0}}
place:
  body: beam
  keep: 3
  noise: {NOISE}
  pool: 8
  search: pool
  spacing: 0.05
  random: 3
  direction: {{type: axis, axis: [1, 0, 0], angles: [0.0, 45.0]}}
  exclude: [{{normal_cone: {{axis: [1, 0, 0], angle: 20}}}}]
field: {{body: beam, instants: 3}}
"""


def changed(**changes: str) -> str:
    """The config with other text in it."""
    text = BEAM
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    return text


def written(folder: Path, **changes: str) -> Path:
    path = folder / "beam.yaml"
    path.write_text(changed(**changes), encoding="utf-8")
    return path


BESIDE = "placed-beam"
ESTIMATED = ("import", "reduce", "place", "simulate", "truth", "estimate")
PLACED = ESTIMATED[:3]


def run(*settings: str, only=PLACED, **changes: str):
    """stage → Artefact of the beam with changes to its text and its keys; its mesh and modes are computed once."""
    return artefacts(changed(**changes), *settings, only=only, beside=BESIDE)


@pytest.fixture(scope="module")
def beam():
    """stage → Artefact of the beam, without its estimate."""
    return run(only=(*PLACED, "simulate", "field"))


def test_a_candidate_strains_as_a_beam_does(beam):
    """ε = (L − x) z/EI per newton, half a beam's height away from clamp and tip."""
    place = beam["place"]
    x, d = place["/candidates/position"], place["/candidates/direction"]
    middle = (np.abs(d[:, 0]) > 0.999) & (np.abs(x[:, 0] - LENGTH / 2) < 0.7)
    assert middle.sum() > 100
    side, down = place["/candidates/response"][middle].T
    arm = LENGTH - x[middle, 0]
    np.testing.assert_allclose(
        side, -arm * x[middle, 1] / (MODULUS * HEIGHT * WIDTH**3 / 12), atol=0.01 * abs(side).max()
    )
    np.testing.assert_allclose(
        down, -arm * x[middle, 2] / (MODULUS * WIDTH * HEIGHT**3 / 12), atol=0.01 * abs(down).max()
    )


@pytest.mark.parametrize(("stage", "heading"), [("place", "place.h5 of a bench"), ("field", "field.h5")])
def test_every_number_of_a_summary_is_listed(beam, stage, heading):
    assert_summary_is_listed(beam[stage], heading)


def test_random_layouts_are_worse_and_drawn_from_all_candidates(beam):
    place = beam["place"]
    drawn = [name for name in place.groups("/layouts") if name != "place"]
    assert drawn == ["random-1", "random-2", "random-3"]
    assert len(place["/candidates/position"]) > 10 * len(place["/pool/candidate"])
    for name in drawn:
        assert place[f"/layouts/{name}/metric"] > place["/layouts/place/metric"]
        assert np.all(place[f"/layouts/{name}/std"] > place["/layouts/place/std"])
    middle = np.median([place[f"/layouts/{name}/std"] for name in drawn], axis=0)
    assert [place.summary[f"random.{name}"] for name in ("side", "down")] == pytest.approx(middle.tolist())


def test_a_sensor_takes_the_layout_over_where_it_was_placed(beam):
    """Statics of a linear bench: what it reads at the start is the response to the constant loads."""
    place, simulate = beam["place"], beam["simulate"]
    load = [1000.0, 500.0]
    for sensor, layout in (("gauges", "place"), ("others", "random-1")):
        own = place[f"/layouts/{layout}/candidate"]
        np.testing.assert_allclose(
            simulate[f"/sensors/{sensor}"][0], place["/candidates/response"][own] @ load, rtol=1e-6, atol=1e-12
        )


@pytest.mark.parametrize(
    "how",
    [
        "estimate.tolerances={position: 0.004, angle: 2.0, gain: 0.03, transverse: 0.01}",
        "estimate.method.noise=as_printed",
    ],
)
def test_tolerances_and_noise_as_printed_are_in_what_was_expected(beam, how):
    done = run("simulate.duration=0.5", "field=null", "estimate.truth.noise=false", how, only=ESTIMATED)
    estimate, place = done["estimate"], done["place"]
    expected = place["/layouts/place/std"]
    found = [estimate[f"/inputs/{name}/std"][-1] for name in place["/inputs"]]
    assert found == pytest.approx(expected.tolist(), rel=1e-3)
    assert np.all(expected > 1.1 * beam["place"]["/layouts/place/std"])


@pytest.mark.parametrize("zeroed", [False, True])
def test_a_gain_makes_a_gauge_as_noisy_as_its_share_of_what_it_reads_in_the_run(zeroed):
    """Statics of a linear bench: rms of the response to a sine and to a load that stays, less what was zeroed at the start."""
    gain = "estimate.tolerances={position: 0.0, angle: 0.0, gain: 0.03, transverse: 0.0}"
    zero = f"sensors.gauges.zeroed={str(zeroed).lower()}"
    sine = "forces.side.signal={type: sine, frequency: 20.0, amplitude: 1000.0}"
    place = run("field=null", gain, zero, sine)["place"]
    response = place["/candidates/response"][place["/pool/candidate"]]
    # one period of the sine is the run
    square = 0.5 * (1000.0 * response[:, 0]) ** 2 + (0.0 if zeroed else (500.0 * response[:, 1]) ** 2)
    np.testing.assert_allclose(place["/augmented/R"][0] / 0.01, NOISE**2 + 0.03**2 * square, rtol=0.01)


def test_a_disturbance_as_printed_is_refused_where_gauges_are_placed(tmp_path):
    with pytest.raises(StrainsightError, match="'place' does not support a disturbance with method"):
        job_of(written(tmp_path), tmp_path, "estimate.method.noise=as_printed", "estimate.disturbance=0.1")


def test_one_gauge_less_is_what_the_file_reports_of_it(beam):
    place = beam["place"]
    without, whole = place["/layouts/place/without"], place["/layouts/place/std"]
    assert np.all(without > whole * (1 - 1e-9))
    lines = (place.path.parent / "gauges.csv").read_text(encoding="utf-8").splitlines()
    head = lines[0].split(",")
    listed = [float(line.split(",")[head.index("std_side_without")]) for line in lines[1:]]
    np.testing.assert_allclose(listed, without[:, 0], rtol=1e-6)
    assert (place.path.parent / "gauges.unv").stat().st_size > 0


SWINGING = {
    "frames:": "  arm: {type: rigid, mass: 20.0, inertia: {xx: 1.0, yy: 1.0, zz: 1.0}, pose: {origin: [2.0, 0, -0.5]}}\n"
    "joints:\n  hinge: {type: revolute, frames: [tip, eye], axis: x}\nframes:\n"
    "  eye: {body: arm, pose: {origin: [0, 0, 0.5]}}\n  end: {body: arm}",
    "forces:": "forces:\n  coil: {type: torsion, frames: [tip, eye], axis: x, stiffness: 400.0}",
    "frame: tip, direction: [0, 1, 0], signal: {type: constant, value: 1000.0}": "frame: end, direction: [0, 1, 0], "
    "signal: {type: sine, frequency: 5.0, amplitude: 800.0}",
    "frame: tip, direction: [0, 0, 1]": "frame: end, direction: [0, 0, 1]",
}
"""An arm on a coil at the beam's tip, which the side load turns by 0.7 rad at 0.05 s."""


@pytest.mark.slow
def test_the_poses_of_a_run_are_served_together():

    def placed(poses):
        text = {**SWINGING, "  random: 3": f"  random: 3\n  poses: {poses}\n  aggregate: worst"}
        return run(**text)["place"]

    first, last, both = placed([0.0]), placed([0.05]), placed([0.0, 0.05])
    assert both.summary["poses"] == 2
    apart = []
    for name in ("random-1", "random-2", "random-3"):
        one, other, together = (own[f"/layouts/{name}/std"] for own in (first, last, both))
        np.testing.assert_allclose(together, np.maximum(one, other), rtol=1e-9)
        apart.append(np.abs(one / other - 1).max())
    assert max(apart) > 0.05


GLUED = "gauges: [{position: [1, 0, 0.095], direction: [1, 0, 0]}]"


@pytest.mark.parametrize(
    ("change", "key", "says"),
    [
        ({"body: beam\n  keep": "body: bean\n  keep"}, "place.body", "you mean beam?"),
        ({"keep: 3": "keep: 30"}, "place.pool", "place.keep (30) exceeds place.pool (8)"),
        ({"random: 3": "random: 3\n  poses: [0, 9]"}, "place.poses", "9 s is after the end of the simulation at 0.05 s"),
        ({"random: 3": "random: 0"}, "sensors.others.layout", "no random layout is computed"),
        ({"body: beam, layout: place": f"body: beam, layout: place, {GLUED}"}, "sensors.gauges", "both"),
        ({BEAM[BEAM.index("place:\n  body") : BEAM.index("field:")]: ""}, "sensors.gauges.layout", "no section 'place'"),
        ({"field: {body: beam, instants: 3}": "field: {body: beam, instants: 3, every: 2}"}, "field.every", "both"),
        ({"keep: 3": "keep: 1"}, "place.keep", "1 gauges cannot observe 2 unknowns"),
        ({"exclude: [": "include: [{box: [[5, 5, 5], [6, 6, 6]]}]\n  exclude: ["}, "place.include", "no admissible facet"),
        # two loads that are one and the same
        ({"direction: [0, 1, 0], signal": "direction: [0, 0, 2], signal"}, "place.keep", "together"),
    ],
)
def test_what_cannot_be_placed_is_refused_with_its_place(change, key, says):
    with pytest.raises(StrainsightError) as caught:
        run(**change)
    assert says in str(caught.value)
    assert key in str([error.key for error in (caught.value, *getattr(caught.value, "others", ()))])


@pytest.mark.slow
def test_a_pool_that_is_widened_to_every_candidate_has_no_candidates_left(tmp_path):
    """With noise far below what an increment makes gauges read, every one could be in a better layout."""
    changes = {"place.pool": 5, "place.keep": 4, "place.noise": 1e-10, "estimate.sensors.gauges.noise": 1e-10}
    found = small(tmp_path, "place", bricks((3, 1, 1)), changes, BENCH_CONFIG)["place"]
    assert len(found["/layouts/place/candidate"]) == 4


SIDE, DOWN = 1000.0, 500.0
AROUND_Z, AROUND_Y = HEIGHT * WIDTH**3 / 12, WIDTH * HEIGHT**3 / 12


FREE = f"bodies.beam.moduli={{E: {{region: 1, value: {MODULUS:e}}}}}"


@pytest.fixture(scope="module")
def loaded():
    """The loaded beam, without gauges, its modulus free: its config, and stage → artefact."""
    settings = ("sensors={}", "place=null", "estimate=null", FREE)
    return load_config(project(BEAM), settings).model, run(*settings, only=("import", "reduce", "simulate", "field"))


@pytest.fixture(scope="module")
def field(loaded):
    return loaded[1]["field"]


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


def test_an_estimated_modulus_scales_the_stress_of_its_instant(loaded):
    """One shape held twice, the second time by a body a tenth stiffer; what was not estimated is as in the config."""
    config, done = loaded
    mesh, reduced = read(Meshes, done["import"]).bodies["beam"], read(ReducedBodies, done["reduce"]).bodies["beam"]
    time, q = np.array([0.0, 1.0]), np.tile(done["simulate"]["/q"][0], (2, 1))
    alone = SimpleNamespace(files={}, progress=silent, sweep=serial)
    scaled, plain = (
        field_output(config, mesh, reduced, BodyMotion(time, q, moduli), alone).datasets
        for moduli in ({"E": MODULUS * np.array([1.0, 1.1])}, {})
    )
    found = scaled["/von_mises"].array
    assert found[1] == pytest.approx(1.1 * found[0], rel=1e-6)
    np.testing.assert_array_equal(plain["/moduli/E"].array, [MODULUS, MODULUS])
    np.testing.assert_allclose(plain["/von_mises"].array, found[0], rtol=1e-6)


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
