"""Which candidates are kept: strength, spacing, zones and outlines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.errors import InfeasibleError, UserError
from strainsight.mesh.facets import exterior_facets
from strainsight.sensors.candidates import candidates
from strainsight.sensors.export import edge_lines, seen_from
from strainsight.sensors.screening import screen, strongest_first
from strainsight.sensors.surface import facet_centres
from strainsight.sensors.zones import Box, Cylinder, NearSet, NormalCone, On, inside, on_surface

from ..bodies import body, stacked
from ..refusals import expect_refusal
from .conftest import tube


def on_a_line(x) -> np.ndarray:
    return np.column_stack([x, np.zeros(len(x)), np.zeros(len(x))])


TIES = 1 + 1e-13 * np.array([0.0, 3.0, 1.0, 2.0])
KEPT = {  # rms over the noise, places, how many to keep, spacing, which are kept
    "a cluster is thinned to its strongest": ([3.0, 5.0, 4.0, 1.0], [0.0, 0.1, 0.2, 5.0], 2, 0.15, [1, 3]),
    "one that is crowded out crowds out nobody": ([3.0, 2.0, 1.0], [0.0, 0.1, 0.2], None, 0.15, [0, 2]),
    "exactly the spacing apart": (np.ones(11), 0.1 * np.arange(11), None, 0.1, np.arange(11)),
    "ties go to the lower index, also when rounding splits them": (TIES, np.arange(4.0), 2, 0.0, [0, 1]),
    "silent ones are all alike": (np.zeros(3), np.arange(3.0), 2, 0.0, [0, 1]),
    "fewer than asked for, by spacing": (np.ones(5), np.arange(5.0), 4, 1.5, [0, 2, 4]),
    "fewer than asked for": (np.ones(5), np.arange(5.0), 6, 0.0, [0, 1, 2, 3, 4]),
}


@pytest.mark.parametrize("case", KEPT)
@pytest.mark.parametrize("scale", [1e-300, 1.0, 1e300])
def test_screening_does_not_depend_on_units(case, scale):
    rms, x, keep, spacing, kept = KEPT[case]
    np.testing.assert_array_equal(screen(scale * np.array(rms), scale, on_a_line(x), keep, spacing).kept, kept)


def test_ties_are_relative_to_the_strongest_signal():
    rms = 1 - 0.6e-8 * np.array([1.0, 0.0, 2.0, 3.0])
    np.testing.assert_array_equal(strongest_first(rms), [0, 1, 2, 3])
    np.testing.assert_array_equal(strongest_first(rms[[2, 0, 1, 3]]), [1, 2, 0, 3])
    weak = np.array([1e-3, 1e-3 + 0.9e-8, 1.0, 0.0])
    np.testing.assert_array_equal(strongest_first(weak), [2, 0, 1, 3])


@pytest.mark.parametrize(
    ("last", "noise", "says"),
    [
        *[(1.0, noise, "gauge noise") for noise in (0.0, -1.0, np.nan, np.inf)],
        (np.nan, 1.0, r"in the training simulation .* are not finite \(number of channels: 1"),
    ],
)
def test_noise_must_be_positive_and_responses_finite(last, noise, says):
    with pytest.raises(InfeasibleError, match=says):
        screen(np.array([1.0, last]), noise, on_a_line([0.0, 1.0]), 1, 0.0)


def test_too_many_bonded_gauges_are_refused():
    what = "only 1 of 3 candidate gauges, but the number of bonded gauges is 2"
    with expect_refusal(InfeasibleError, what, remedy="at least 2"):
        screen(np.ones(3), 1.0, on_a_line(np.arange(3)), 1, 0.0, bonded=np.array([True, True, False]))


def test_gauge_over_range_is_dropped_unless_bonded():
    gauge = np.array([0, 0, 1, 1, 2, 3])
    result = screen(
        np.array([5.0, 5.0, 4.0, 4.0, 3.0, 9.0]),
        1.0,
        on_a_line([0.0, 0.0, 0.1, 0.1, 0.2, 5.0]),
        None,
        0.15,
        gauge=gauge,
        bonded=gauge == 3,
        largest=np.array([7.0, 10.1, 10.0, 2.0, 99.0, 99.0]),
        limit=np.array([10.0, 10.0, 10.0, 10.0, np.inf, 10.0]),
    )
    np.testing.assert_array_equal(result.reason, ["range", "", "spacing", ""])
    what = r"the readings of every candidate gauge exceed its measuring range \(number of candidates: 4\)"
    with expect_refusal(InfeasibleError, what, key="gauges.range"):
        screen(np.ones(4), 1.0, on_a_line(np.arange(4)), 3, 0.0, largest=np.array([2, 2, 3, 4]), limit=np.ones(4))


@pytest.mark.parametrize("keep", [None, 25])
def test_screening_agrees_with_plain_loop(keep):
    rng = np.random.default_rng(3)
    sizes = rng.integers(1, 4, 150)
    gauge = np.repeat(np.arange(150), sizes)
    place = rng.uniform(0, 1, (150, 3))
    rms, noise = rng.uniform(0, 1, len(gauge)), rng.uniform(0.5, 2, len(gauge))
    largest, bonded = 3 * rms, np.isin(np.arange(150), [7, 80, 81])
    snr = [sum((rms[gauge == g] / noise[gauge == g]) ** 2) ** 0.5 for g in range(150)]
    over = [bool(np.any(largest[gauge == g] > 2.7)) and not bonded[g] for g in range(150)]
    kept: list[int] = []
    for g in sorted(range(150), key=lambda g: (not bonded[g], -snr[g])):
        apart = bonded[g] or all(np.linalg.norm(place[g] - place[j]) >= 0.15 for j in kept)
        if apart and not over[g] and (keep is None or len(kept) < keep):
            kept.append(g)
    result = screen(
        rms,
        noise,
        place[gauge],
        keep,
        0.15,
        gauge=gauge,
        bonded=bonded[gauge],
        largest=largest,
        limit=np.full(len(gauge), 2.7),
    )
    np.testing.assert_array_equal(result.kept, sorted(kept))
    np.testing.assert_allclose(result.snr, snr)
    np.testing.assert_array_equal(result.reason == "range", over)


def test_load_cases_select_gauges_in_turn():
    rms = np.array([[9.0, 8.0, 7.0, 4.0, 3.0, 0.1, 0.2, 0.0], [0.01, 0.0, 0.0, 0.0, 0.01, 0.04, 0.03, 0.09]])
    position = on_a_line([0.0, 0.1, 0.2, 1.0, 2.0, 3.0, 4.0, 5.0])
    result = screen(rms, 0.5, position, 4, 0.25)
    np.testing.assert_array_equal(result.kept, [0, 3, 5, 7])
    np.testing.assert_array_equal(result.reason, ["", "spacing", "spacing", "", "snr", "", "snr", ""])
    np.testing.assert_allclose(result.snr, [18.0, 16.0, 14.0, 8.0, 6.0, 0.2, 0.4, 0.18])
    np.testing.assert_array_equal(screen(rms * [[1.0], [1e6]], 0.5, position, 4, 0.25).kept, result.kept)
    assert len(screen(rms, 0.5, position, None, 0.25).kept) == 6


MESHES = Path(__file__).parents[2] / "meshes"


@pytest.fixture(scope="module")
def beam():
    mesh = read_mesh(MESHES / "cantilever.bdf")
    order = np.argsort(np.linalg.norm(mesh.position - [2.0, 0.125, 0.095], axis=1))
    return replace(mesh, node_sets={"corner": mesh.node_ids[order[:2]]}, element_sets={"first": np.array([1])})


def kept(mesh, axis, *zones):
    return candidates(mesh, exterior_facets(mesh), axis, exclude=zones)


def test_a_cone_takes_the_facets_that_face_along_its_axis_either_way(beam):
    every = kept(beam, (1, 0, 0))
    sides = kept(beam, (1, 0, 0), NormalCone((0, 0, -2), 1.0))
    assert len(sides) == np.count_nonzero(np.abs(every.normal[:, 2]) < 0.5)
    assert np.all(np.abs(sides.normal[:, 1]) > 0.99)
    assert len(kept(beam, (1, 0, 0), NormalCone((0, 1, 1), 44.0))) == len(every)


def test_a_cone_around_the_gauge_axis_corrects_an_axis_along_a_normal(beam):
    with expect_refusal(
        InfeasibleError, "within 10° of the normal", remedy="normal_cone: {axis: [0, 0, 1], angle: 10}"
    ):
        kept(beam, (0, 0, 1))
    assert np.all(np.abs(kept(beam, (0, 0, 1), NormalCone((0, 0, 1), 10.0)).normal[:, 1]) > 0.99)


def test_a_cylinder_has_its_axis_and_no_ends(beam):
    zone = Cylinder((1.0, 0.0, 7.0), (0, 0, -3.0), 0.3)
    every, left = kept(beam, (1, 0, 0)), kept(beam, (1, 0, 0), zone)
    away = np.hypot(every.position[:, 0] - 1.0, every.position[:, 1]) >= 0.3
    np.testing.assert_array_equal(left.position, every.position[away])
    assert 0 < len(left) < len(every)


@pytest.mark.parametrize("name", ["corner", "first"])
def test_a_set_keeps_gauges_at_a_distance_from_its_nodes(beam, name):
    every, left = kept(beam, (1, 0, 0)), kept(beam, (1, 0, 0), NearSet(name, 0.2))
    ids = beam.node_sets["corner"] if name == "corner" else beam.node_ids[beam.blocks[0].nodes[beam.blocks[0].ids == 1]]
    nodes = beam.position[np.isin(beam.node_ids, ids)]
    apart = np.linalg.norm(every.position[:, None] - nodes, axis=2).min(axis=1) >= 0.2
    np.testing.assert_array_equal(left.position, every.position[apart])
    assert 0 < len(left) < len(every)


@pytest.mark.parametrize(
    ("zone", "says"),
    [
        (NearSet("korner", 0.1), "korner"),
        (Cylinder((0, 0, 0), (0, 0, 0), 0.1), "the axis is"),
        (NormalCone((0, 0, 0), 10.0), "the axis is"),
    ],
)
def test_empty_zone_is_refused(beam, zone, says):
    with pytest.raises(UserError, match=says):
        kept(beam, (1, 0, 0), zone)
    assert len(kept(beam, (1, 0, 0), Box((5, 5, 5), (6, 6, 6)))) == len(kept(beam, (1, 0, 0)))


@pytest.mark.parametrize("name", ["below", "above"])
def test_zone_on_touching_parts_selects_one_part(name):
    one = body("hex8", (4, 4, 1), lambda u, v, w: (u, v, w))
    z, n, ids = one.position[:, 2], len(one.position), one.node_ids
    mesh = replace(stacked(one, np.eye(3)[2]), node_sets={"below": ids[z == 1], "above": n + ids[z == 0]})
    facets = exterior_facets(mesh)
    centre, normal = facet_centres(mesh.position, facets.kind, facets.nodes)
    there = on_surface(mesh, facets, name)
    assert np.count_nonzero(there) == 16
    np.testing.assert_array_equal(inside(On(name), mesh, facets, centre, normal), there)


SIZE = np.array([1.0, 0.3, 0.2])


def length(segments):
    return np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [1, -1])
def test_hidden_edges_of_a_box_from_the_front(box_mesh, axis, side):
    lines = edge_lines(box_mesh.position, exterior_facets(box_mesh))
    toward = side * np.eye(3)[axis]
    seen, hidden = seen_from(lines, toward)
    rest = np.delete(SIZE, axis)
    assert length(hidden) == pytest.approx(2 * rest.sum())
    assert length(seen) == pytest.approx(2 * rest.sum() + 4 * SIZE[axis])
    far = 0.0 if side > 0 else SIZE[axis]
    np.testing.assert_allclose(hidden[..., axis], far, atol=1e-12)


def test_hidden_edges_of_a_box_from_an_oblique_view(box_mesh):
    lines = edge_lines(box_mesh.position, exterior_facets(box_mesh))
    seen, hidden = seen_from(lines, np.array([1.0, 2.0, 3.0]))
    assert length(hidden) == pytest.approx(SIZE.sum())
    assert np.sum(~hidden.reshape(-1, 3).any(axis=1)) == 3
    assert length(seen) == pytest.approx(3 * SIZE.sum())


@pytest.mark.parametrize("kind", ["quad4", "quad8", "tri6"])
def test_a_tube_seen_across_is_bounded_where_its_skin_turns_away(kind):
    radius, along, around = 2.0, 5, 48
    lines = edge_lines(*tube(kind, around, along, radius))
    seen, _ = seen_from(lines, np.array([1.0, 0.0, 0.0]))
    straight = seen[np.abs(seen[:, 0, 2] - seen[:, 1, 2]) > 1e-9]
    # of triangles the diagonals, too, where the skin turns between two of one cell
    assert np.abs(straight[..., 1]).min() > radius * np.cos(2 * np.pi / around) - 1e-9
    np.testing.assert_allclose(length(straight), 2 * along, rtol=0.05)
    rims = seen[np.abs(seen[:, 0, 2] - seen[:, 1, 2]) < 1e-9]
    assert set(np.round(rims[..., 2].ravel(), 9)) >= {0.0, float(along)}
