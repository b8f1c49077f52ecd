"""The structure to turn round: the few triangles look like the many, and the page's numbers are the layout's."""

import base64
import json
import re
import zlib

import numpy as np
import pytest
import pyvista as pv

from strainsight.pages.picture.layout import Gauge, LoadArrow, PictureLayout
from strainsight.pages.space.model import ShownState, contour_of, space, surface, vertex_shift
from strainsight.pages.space.section import space_section
from strainsight.pages.view.viewing import FACETS, Panel, View, _colours

from ...shared import slowly

NOTHING = np.empty((0, 3))


def facets(mesh):
    """The triangles of a PyVista surface as facets padded with −1."""
    triangle = mesh.faces.reshape(-1, 4)[:, 1:]
    return np.column_stack([triangle, np.full((len(triangle), 5), -1)])


@pytest.fixture(scope="module")
def ball():
    return pv.Icosphere(radius=2.0, nsub=6)


@pytest.fixture(scope="module")
def cube():
    return pv.Cube().triangulate().subdivide(2, "linear").clean()


def layout_of(mesh, **more):
    return PictureLayout(np.asarray(mesh.points, float), facets(mesh), NOTHING, more.pop("gauges", ()), **more)


def gauge(label="G1", position=(0.5, 0.0, 0.0), normal=(1.0, 0.0, 0.0), **more):
    direction = np.array([0.0, 0.0, 1.0])
    return Gauge(label, 7, 3, np.array(position), direction, np.array(normal), 12.5, nodes=(4, 5, 6), **more)


@pytest.mark.parametrize("largest", [2000, *slowly(8000)])
def test_a_thinned_surface_stays_on_the_old_one(ball, largest):
    drawn = surface(np.asarray(ball.points, float), facets(ball), largest=largest)
    assert drawn.thinned
    assert 0.9 * largest < len(drawn.triangle) <= 1.05 * largest
    assert np.abs(np.linalg.norm(drawn.position, axis=1) - 2.0).max() < 0.01
    assert np.linalg.norm(drawn.position - ball.points[drawn.source], axis=1).max() < 0.15
    corner = drawn.position[drawn.triangle]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(4 * np.pi * 2.0**2, rel=0.01)


def test_vertices_move_with_the_points_they_stand_for(cube):
    layout = layout_of(cube, gauges=(gauge(),), loads=(LoadArrow("tip", np.array([0.5, 0.5, 0.5]), np.array([0, 0, 1.0])),))
    model = space([layout])
    stretched = vertex_shift(model, ShownState("stretched", 0.1 * layout.points))
    body = surface(layout.points, layout.faces)
    assert np.abs(stretched[: len(body.position)] - 0.1 * body.position).max() < 1e-6
    # Gauge and arrow go as a whole, with the points they sit on.
    assert np.unique(stretched[len(body.position) :].round(9), axis=0).shape[0] == 2


def unpacked(page):
    """The arrays of the page, decoded without the code that packed them."""
    content = json.loads(re.search(r'id="space-data">(.*?)</script>', page, re.DOTALL)[1])
    data = zlib.decompress(base64.b64decode(content["arrays"]))
    count, at, arrays = content["vertices"], 0, []
    kinds = [("<u2", 3 * count), ("i1", 3 * count), ("u1", 3 * count)]
    kinds += [("<u4", part["count"]) for part in content["parts"]]
    for state in content["states"]:
        kinds += [("i1", 3 * count)] * (state["largest"] > 0) + [("u1", content["surface"])] * bool(state["stops"])
    for kind, size in kinds:
        arrays.append(np.frombuffer(data, kind, size, at))
        at += arrays[-1].nbytes
    assert at == len(data)
    return content, arrays


def test_the_page_holds_the_structure_to_a_pixel(cube):
    layout = layout_of(cube, gauges=(gauge(),), fixed=np.array([[-0.5, 0.0, 0.0]]))
    wave = np.sin(3 * layout.points)
    content, arrays = unpacked(space_section([("", layout)], [ShownState("mode 1, 12 Hz", wave)]))
    model = space([layout])
    position = np.array(content["low"]) + np.array(content["span"]) * arrays[0].reshape(-1, 3) / 65535
    assert np.abs(position - model.position).max() <= 0.51 / 65535 * max(content["span"])
    assert np.abs(arrays[1].reshape(-1, 3) / 127 - model.normal).max() < 0.005
    for part, own, index in zip(content["parts"], model.parts, arrays[3:], strict=False):
        assert part["primitive"] == own.primitive
        assert (index == own.index.ravel()).all()
    shift = content["states"][0]["largest"] * arrays[-1].reshape(-1, 3) / 127
    assert np.abs(shift - wave[model.source]).max() < 0.005


def test_a_contour_holds_its_values_to_a_step_of_its_scale(cube):
    layout = layout_of(cube)
    middle = layout.points[layout.faces[:, :3]].mean(axis=1)
    values = 40.0 * middle[:, 0] + 7.0
    contour = contour_of(values, layout, "strain", "µm/m")
    scale = contour.scale
    assert (scale.low, scale.high) == (-values.max(), values.max())  # both signs: about zero
    shape = ShownState("F alone", contour=contour, group="Strain")
    page = space_section([("", layout)], [shape, ShownState("mode 1, 12 Hz", layout.points)])
    content, arrays = unpacked(page)
    triangles = np.sum([part["count"] // 3 for part in content["parts"] if part["primitive"] == "triangles"])
    assert triangles == cube.n_cells
    # every point has the mean of the facets about it
    shown = scale.low + (scale.high - scale.low) * arrays[-2] / 254
    source = space([layout]).source
    for vertex in range(0, content["surface"], 7):
        about = np.any(layout.faces == source[vertex], axis=1)
        assert shown[vertex] == pytest.approx(values[about].mean(), abs=0.51 / 254 * (scale.high - scale.low))
    first, last = content["states"][0]["stops"][0], content["states"][0]["stops"][-1]
    assert f"linear-gradient(to right, #{bytes(first).hex()}" in page
    assert f"#{bytes(last).hex()})" in page
    assert 'aria-label="strain from −' in page
    assert page.count('<div data-state="0" hidden>') == 1
    assert [state["largest"] > 0 for state in content["states"]] == [False, True]


def strip(last):
    """Squares of side one in a row, 199 of them, and one that is `last` long."""
    points = np.array([(x, y, 0.0) for x in [*range(200), 199.0 + last] for y in (0.0, 1.0)])
    first = 2 * np.arange(200)
    faces = np.column_stack([first, first + 2, first + 3, first + 1, *[np.full(200, -1)] * 4])
    return PictureLayout(points, faces, NOTHING, ())


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_peak_on_less_than_a_hundredth_of_the_surface_lies_beyond_the_scale(sign):
    """1 % of the area are 1.997 squares: the peak and the square beside it may be beyond the end, the next may not."""
    layout = strip(0.7)
    values = sign * np.linspace(-10.0, 20.0, 200)
    values[-1] = sign * 500.0
    own = contour_of(values, layout, "strain", "µm/m")
    end = abs(values[-3])
    assert (own.scale.low, own.scale.high) == pytest.approx((-end, end), rel=1e-12)
    assert (own.scale.below, own.scale.above) == (sign < 0, sign > 0)
    assert (own.least, own.largest) == (values.min(), values.max())
    window = _colours(View("", layout, quantity="strain", unit="µm/m", on=FACETS), Panel("", values), 0)
    assert window["clim"] == (own.scale.low, own.scale.high)
    assert f"extremes {values[-1]:.3g}" in window["scalar_bar_args"]["title"]
    page = space_section([("", layout)], [ShownState("F alone", contour=own)])
    low, high = re.search(r'class="ends"><span>(.*?)</span>.*<span>(.*?)</span></p>', page).groups()
    assert ("≤" in low, "≥" in high) == (sign < 0, sign > 0)
    assert contour_of(values, strip(3.0), "strain", "µm/m").scale.high == 500.0
    rest = contour_of(np.where(values * sign > 0, sign * values, -1e-13), layout, "strain", "µm/m")
    assert (rest.least, rest.scale.low) == (0.0, 0.0)  # rounding has no sign
    assert contour_of(np.abs(values), layout, "stress", "MPa").scale.low == np.abs(values).min()


def test_gauges_are_there_as_large_as_they_are_to_be_seen_and_to_scale(cube):
    """A foil of 8 × 4.5 mm, measured on the vertices of its part; a sensor that is bonded by none is drawn alike either way."""
    glued, loose = gauge(foil=(0.008, 0.0045)), gauge(label="A1", position=(-0.5, 0.0, 0.0), kind="accelerometer")
    layout = layout_of(cube, gauges=(glued, loose))
    model = space([layout])
    parts = {part.when: part for part in model.parts if part.when in ("seen", "scale")}
    assert len(parts) == 2
    extent = {}
    for name, part in parts.items():
        own = model.position[np.unique(part.index)]
        extent[name] = np.ptp(own[own[:, 0] > 0], axis=0)
    assert extent["scale"][2] == pytest.approx(0.008, abs=1e-7)  # along z
    assert extent["scale"][1] == pytest.approx(0.0045, abs=1e-7)
    assert extent["seen"][2] > 5 * extent["scale"][2]
    blocks = [np.sum(model.position[np.unique(part.index), 0] < 0) for part in parts.values()]
    assert blocks[0] == blocks[1] > 0
    assert 'id="space-true"' in space_section([("", layout)])
    assert 'id="space-true"' not in space_section([("", layout_of(cube, gauges=(loose,)))])
