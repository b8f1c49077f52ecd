"""Sides of beams: where they lie, and what a gauge on them reads of a stretched, bent and twisted beam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.fem.recovery import facet_strain
from strainsight.fem.stress import surface_model, surface_state
from strainsight.gauges.candidates import candidates
from strainsight.gauges.edges import sharp_edges
from strainsight.gauges.faces import faces_of
from strainsight.gauges.rows import channel_rows
from strainsight.gauges.walk import skin_of, walk
from strainsight.mesh.beam_sides import with_sides
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.section_shapes import section_of_shape
from strainsight.mesh.thin import BeamSection

from ..fem.test_thin import NU, E, L, line, straight

H, B = 0.03, 0.02
"""Along z and y."""
POINTS = np.array([[B / 2, H / 2], [-B / 2, H / 2], [-B / 2, -H / 2], [B / 2, -H / 2]])
SECTION = BeamSection(B * H, np.diag([H * B**3, B * H**3]) / 12, 1e-8, points=POINTS)


def bent(force, count=8, offset=(0.0, 0.0, 0.0), moment=None):
    """A cantilever under a tip force, its field, and all candidates along the beam at some angles."""
    mesh = with_sides(straight(count, section=SECTION, offset=offset))
    model = build_model(mesh)
    load = (
        PointLoad("f", direction=force, node_id=count + 1)
        if moment is None
        else PointLoad("m", moment=moment, node_id=count + 1)
    )
    S = input_shape(model, [load])
    z = nodal(model, spsolve(model.stiffness.constant.tocsc(), S[:, 0])[:, None])
    return (
        mesh,
        z,
        candidates(mesh, exterior_facets(mesh), axis=(1.0, 0.0, 0.0), angles=(0.0, 30.0, 90.0), on_constraints=True),
    )


def test_sides_are_those_of_the_box_about_the_points_of_the_section_and_look_outward():
    mesh = with_sides(straight(2, section=SECTION, offset=(0.0, 0.01, 0.0)))
    every = candidates(mesh, exterior_facets(mesh), axis=(1.0, 0.0, 0.0), on_constraints=True)
    np.testing.assert_allclose(every.normal, [[0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, -1]] * 2, atol=1e-12)
    expected = [[0, B / 2], [1, H / 2], [0, -B / 2], [1, -H / 2]]
    for (axis, height), x in zip(expected * 2, every.position[:, 1:], strict=True):
        assert x[axis] == pytest.approx(height + (0.01 if axis == 0 else 0.0))


def test_without_points_they_are_those_of_a_square_of_the_same_area():
    mesh = with_sides(straight(1, section=replace(SECTION, points=np.zeros((0, 2)))))
    np.testing.assert_allclose(np.ptp(mesh.position[mesh.arms[:, 0]], axis=0)[1:], np.sqrt(B * H))


def test_rods_and_beams_with_pins_have_none():
    assert not len(with_sides(straight(2, kind="rod", section=SECTION)).arms)
    beam = straight(2, section=SECTION)
    released = beam.beams[0].released.copy()
    released[0, 1, 4] = True
    mesh = with_sides(replace(beam, beams=(replace(beam.beams[0], released=released),)))
    assert len(mesh.arms) == 16
    assert (mesh.beams[0].on_sides[0] == -1).all()


@pytest.mark.parametrize(("force", "axis", "I"), [((0, 0, 1), 2, B * H**3 / 12), ((0, 1, 0), 1, H * B**3 / 12)])
def test_a_gauge_reads_bending_as_its_theory_has_it_at_any_angle(force, axis, I):
    """ε = −M c/(E I) along the beam, −ν ε across it."""
    mesh, z, every = bent(force)
    along = -(L - every.position[:, 0]) * every.position[:, axis] / (E * I)
    cos, sin = np.cos(np.deg2rad(every.angle)), np.sin(np.deg2rad(every.angle))
    read = channel_rows(mesh.position, every, z)[:, 0]
    np.testing.assert_allclose(read, along * (cos**2 - NU * sin**2), atol=1e-9 * np.abs(along).max())


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.0, 0.02, -0.01)])
def test_it_reads_stretch_and_what_an_offset_bends(offset):
    mesh, z, every = bent((1, 0, 0), offset=offset)
    _, y, h = every.position.T
    # the force acts at the node, off the middle of the section by the offset
    bend = 12 * offset[1] * (y - offset[1]) / (H * B**3) + 12 * offset[2] * (h - offset[2]) / (B * H**3)
    strain = (1 / (B * H) - bend) / E
    read = channel_rows(mesh.position, every, z)[:, 0]
    own = every.angle == 0
    np.testing.assert_allclose(read[own], strain[own], rtol=1e-8)


def test_stress_on_a_side_is_along_the_beam():
    mesh, z, _ = bent((0, 0, 1))
    facets = exterior_facets(mesh)
    own = facets.facet == 2
    state = surface_state(surface_model(mesh, facet_strain(mesh, facets), z), {}, np.ones(1))
    stress = state.stress[own]
    centre = mesh.position[facets.nodes[own][:, :4]].mean(axis=1)
    np.testing.assert_allclose(stress[:, 0], -(L - centre[:, 0]) * H / 2 / (B * H**3 / 12), rtol=1e-8)
    np.testing.assert_allclose(stress[:, 1:], 0.0, atol=1e-8 * np.abs(stress).max())


def test_a_beam_in_space_reads_the_same_as_one_along_an_axis():
    a = np.array([0.3, -0.2, 0.5])
    a /= np.linalg.norm(a)
    x = np.linspace(0, L, 5)[:, None] * a
    mesh = with_sides(line(x, section=SECTION))
    model = build_model(mesh)
    across = mesh.beams[0].axes[0][:, 2]
    S = input_shape(model, [PointLoad("f", direction=tuple(across), node_id=5)])
    z = nodal(model, spsolve(model.stiffness.constant.tocsc(), S[:, 0])[:, None])
    every = candidates(mesh, exterior_facets(mesh), axis=tuple(a), on_constraints=True)
    s, c = every.position @ a, every.position @ across
    np.testing.assert_allclose(
        channel_rows(mesh.position, every, z)[:, 0], -(L - s) * c / (E * B * H**3 / 12), atol=1e-12
    )


def test_a_side_goes_on_over_the_beams_that_carry_it_up_to_a_knee():
    """Six beams in line are four faces from end to end, and a grid walks over their joints; a knee of 90° parts them."""
    mesh = with_sides(straight(6, section=SECTION))
    facets = exterior_facets(mesh)
    faces = faces_of(mesh.position, facets)
    np.testing.assert_allclose(np.sort(faces.area), [L * B, L * B, L * H, L * H])
    assert [faces.of[facets.facet == side].tolist() for side in (1, 2, 3, 4)] == [[f] * 6 for f in faces.of[:4]]
    along = np.array([[1.0, 0.0, 0.0]])
    start = np.array([[0.5 * L / 6, 0.0, H / 2]])
    trail = walk(
        skin_of(mesh.position, facets), np.array([1]), start, np.array([[0.0, 0.0, 1.0]]), along, np.array([0.7 * L])
    )
    assert trail.reached.all()
    assert facets.element_id[trail.last[0]] == mesh.beams[0].ids[4]
    # across the beam nothing is nearer than its edges along it and its ends
    ends = sharp_edges(mesh.position, facets)
    across = np.ptp(ends[:, :, 0], axis=1) == 0
    np.testing.assert_allclose(np.unique(ends[across][:, 0, 0]), [0, L], atol=1e-12)
    x = np.array([[0, 0, 0], [L / 2, 0, 0], [L, 0, 0], [L, L / 2, 0], [L, L, 0.0]])
    knee = with_sides(line(x, section=SECTION))
    assert len(faces_of(knee.position, exterior_facets(knee)).area) == 8


@pytest.mark.parametrize(
    ("shape", "dimensions", "sides"),
    [
        ("BAR", (0.02, 0.03), "+y +z -y -z"),
        ("TUBE", (0.02, 0.018), "+y +z -y -z"),
        ("BOX", (0.04, 0.06, 0.002, 0.003), "+y +z -y -z"),
        ("I", (0.1, 0.05, 0.06, 0.004, 0.005, 0.006), "+y -y"),
        ("H", (0.04, 0.01, 0.05, 0.004), "+z -z"),
        ("CHAN", (0.04, 0.08, 0.004, 0.005), "+y -y -z"),
        ("CHAN2", (0.004, 0.005, 0.06, 0.04), "+z -y -z"),
        ("L", (0.04, 0.06, 0.004, 0.005), "-y -z"),
        ("T", (0.05, 0.06, 0.004, 0.005), "+y -y"),
        ("HAT", (0.04, 0.003, 0.03, 0.02), "+y"),
        ("HEXA", (0.01, 0.05, 0.03), "+y -y"),
        ("Z", (0.03, 0.004, 0.06, 0.07), "+y -y"),
        ("CROSS", (0.03, 0.005, 0.05, 0.004), "+y +z -y -z"),
    ],
)
def test_a_section_has_the_sides_that_it_is_drawn_with(shape, dimensions, sides):
    """By the figures of the PBARL, y up and z to the right."""
    section = section_of_shape(shape, dimensions)
    found = [name for name, there in zip(("+y", "+z", "-y", "-z"), section.sides, strict=True) if there]
    assert found == sides.split()
    mesh = with_sides(straight(2, section=section))
    assert exterior_facets(mesh).facet.tolist() == 2 * [1 + ["+y", "+z", "-y", "-z"].index(name) for name in found]
    assert len(mesh.arms) == 2 * 4 * len(found)
