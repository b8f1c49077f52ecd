"""Candidates that keep a clearance, and what becomes of it on a part that is too small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

from strainsight import api
from strainsight.errors import InfeasibleError, UserError
from strainsight.experiment.structure.clearance import (
    CHOICE,
    clearance_in_words,
    clearance_of,
    clearance_warning,
    loaded_nodes,
)
from strainsight.experiment.structure.structure import Structure
from strainsight.mesh.additions import with_face
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import NodalForces
from strainsight.sensors.edges import carrier_clearance

from ..edges.beam import PLACEMENT_CONFIG, SIZE, bricks
from ..mesh.test_shell_faces import plate, strip

CELLS = (10, 10, 8)


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """Overrides → training and screening of a beam of 1 × 0.1 × 0.08 m held at x = 0, in bricks of 0.1 × 0.01 × 0.01 m. A seat is
    named in the middle of its top: cells with centres from x = 0.35 to 0.65 m, y = 0.035 to 0.065 m."""
    folder = tmp_path_factory.mktemp("beam")
    (folder / "beam.bdf").write_text(bricks(CELLS), encoding="ascii")
    (folder / "edge.yaml").write_text(yaml.safe_dump(PLACEMENT_CONFIG), encoding="utf-8")
    seat = "mesh.faces={seat: {box: [[0.34, 0.03, 0.0799], [0.66, 0.07, 0.0801]]}}"
    plain = api.load(folder / "edge.yaml", [seat])
    mesh = api.mesh(plain)
    reduced = api.reduce(plain, mesh)

    def screened(*overrides):
        loose = "screen.keep=all", "screen.minimum_spacing=0", "place.keep=2"
        case = api.load(folder / "edge.yaml", [seat, *loose, *overrides])
        training = api.train(case, mesh, reduced)
        return training, api.screen(case, mesh, reduced, training)

    screened.case = lambda *overrides: api.load(folder / "edge.yaml", list(overrides))
    screened.mesh, screened.reduced = mesh, reduced
    return screened


def aside(x):
    """Distance of points on the sides of the beam to its nearest edge along it."""
    y, z = np.minimum(x[:, 1], SIZE[1] - x[:, 1]), np.minimum(x[:, 2], SIZE[2] - x[:, 2])
    return np.where(np.minimum(y, z) == 0, np.maximum(y, z), np.minimum(y, z))


@pytest.mark.parametrize("clearance", [0.006, 0.02])
def test_a_stated_clearance_is_kept_exactly(beam, clearance):
    training, screened = beam(f"gauges.clearance={clearance}")
    x = training.candidates.position[training.candidates.first]
    x = x - np.array([0.0, x[:, 1].min(), x[:, 2].min()])
    sides = (x[:, 0] > clearance) & (x[:, 0] < SIZE[0] - 0.2)
    stays = screened.reason != "clearance"
    np.testing.assert_array_equal(stays[sides], (aside(x) >= clearance - 1e-12)[sides])
    assert screened.clearance.distance == screened.clearance.wanted == clearance
    assert screened.clearance.rule == "stated"
    assert 0 < screened.clearance.near["edges"] <= np.count_nonzero(~stays)


def test_the_default_is_the_carrier_of_the_grid(beam):
    _, screened = beam()
    assert screened.clearance.distance == carrier_clearance(0.0)
    assert screened.clearance.rule == "carrier"
    assert clearance_warning(screened.clearance) == ""
    assert "4.59 mm" in clearance_in_words(screened.clearance, 7)
    _, longer = beam("gauges.grid_length=0.006")
    assert longer.clearance.distance == carrier_clearance(0.006) > screened.clearance.distance


def test_a_default_that_leaves_no_choice_is_halved_with_a_word_and_a_stated_one_is_refused(beam):
    """A carrier of 65 × 33 mm on a beam of 80 mm: 36 mm from every edge leave a line, a half of it strips on all sides; where
    places are to be 0.3 m apart there is no choice whatever the clearance."""
    training, _ = beam()
    case = beam.case("screen.keep=all", "screen.minimum_spacing=0", "gauges.grid_length=0.06")
    free = np.zeros(training.candidates.gauges, dtype=bool)
    found, blocked = clearance_of(Structure(case.config, {}, beam.mesh, beam.reduced, training), free)
    assert found.wanted == carrier_clearance(0.06)
    assert found.distance == 0.5 * found.wanted
    left = np.unique(training.candidates.position[training.candidates.first[~blocked]], axis=0)
    assert len(left) >= CHOICE
    assert f"{1e3 * found.distance:.3g} mm is used" in clearance_warning(found)
    # most of its few locations stay: that there are few is no reason for gauges at an edge
    few = beam.case("screen.keep=all", "screen.minimum_spacing=0.07")
    found, blocked = clearance_of(Structure(few.config, {}, beam.mesh, beam.reduced, training), free)
    assert found.distance == found.wanted
    assert 20 <= found.needed < CHOICE
    sparse = beam.case("screen.keep=all", "screen.minimum_spacing=0.3")
    found, blocked = clearance_of(Structure(sparse.config, {}, beam.mesh, beam.reduced, training), free)
    assert found.distance == 0
    assert not blocked.any()
    assert "no clearance is used" in clearance_warning(found)
    with pytest.raises(InfeasibleError, match=r"gauges\.clearance: none of \d+ candidates is at least 51"):
        beam("gauges.clearance=0.051")


def test_noise_relative_to_the_strongest_candidate_is_that_of_the_strongest_that_may_be_taken(beam):
    training, screened = beam("gauges.noise_std={relative_to_strongest: 0.01}", "gauges.clearance=0.02")
    rms = np.sqrt(np.mean(training.reading() ** 2, axis=0))
    assert screened.noise_std[0] == pytest.approx(0.01 * rms[(screened.reason != "clearance")[training.candidates.gauge]].max())


def nodes_of(case, mesh, **update):
    """Loaded nodes of the config with its load elsewhere."""
    name, load = next(iter(case.config.loads.items()))
    own = load.model_copy(update={"node": None, "set": None, "deck_load": None} | update)
    return loaded_nodes(case.config.model_copy(update={"loads": {name: own}}), mesh, exterior_facets(mesh))


def test_loads_at_a_node_on_a_set_and_of_the_deck_have_their_nodes_and_weight_has_none(beam):
    """A load on every node of the body, as weight is, has no place to stay clear of."""
    mesh, case = beam.mesh, beam.case()
    facets = exterior_facets(mesh)
    outside = np.unique(facets.nodes[facets.nodes >= 0])
    top = mesh.node_ids[outside[:3]]
    every = np.unique(np.concatenate([block.nodes.ravel() for block in mesh.blocks]))
    assert len(every) > len(outside)
    loads = {
        "patch": NodalForces(outside[5:7], np.array([[0, 0, 1.0], [0, 0, 0]])),
        "weight": NodalForces(every, np.tile([0, 0, 1.0], (len(every), 1))),
    }
    marked = replace(mesh, node_sets={"top": top}, loads=loads)
    np.testing.assert_array_equal(nodes_of(case, marked, set="top"), np.sort(outside[:3]))
    np.testing.assert_array_equal(nodes_of(case, marked, node=int(top[1])), outside[1:2])
    np.testing.assert_array_equal(nodes_of(case, marked, deck_load="patch"), outside[5:6])
    assert len(nodes_of(case, marked, deck_load="weight")) == 0


def test_a_moment_on_a_plain_node_has_the_nodes_of_its_elements(beam):
    """In bricks, those of the surface within one brick of the node; a force there has that node alone."""
    mesh, case = beam.mesh, beam.case()
    facets = exterior_facets(mesh)
    outside = np.unique(facets.nodes[facets.nodes >= 0])
    middle = outside[np.argmin(np.abs(mesh.position[outside] - mesh.position[outside].mean(axis=0)).sum(axis=1))]
    node = int(mesh.node_ids[middle])
    apart = np.abs(mesh.position[outside] - mesh.position[middle]) / (np.array(SIZE) / CELLS)
    near = outside[np.all(apart < 1.5, axis=1)]
    assert 8 < len(near) < 20
    np.testing.assert_array_equal(nodes_of(case, mesh, node=node, direction=None, moment=(0.0, 0.0, 1.0)), near)
    np.testing.assert_array_equal(nodes_of(case, mesh, node=node), [middle])


def test_what_is_spread_over_shells_leaves_them_free_and_a_line_or_a_node_of_theirs_does_not(beam):
    """The four nodes around a square, on both faces: a pressure on a face has no place to stay clear of, a line load has."""
    mesh, case = plate(*strip()), beam.case()
    facets = exterior_facets(mesh)
    line = replace(mesh, node_sets={"line": np.array([100, 103])})
    marked = with_face(line, "upper", facets, np.flatnonzero(facets.facet == 1))
    assert len(nodes_of(case, marked, set="upper", pressure=True)) == 0
    for update, at in (({"set": "line"}, [0.0, 0.0, 1.0, 1.0]), ({"node": 100}, [0.0, 0.0])):
        found = nodes_of(case, marked, **update)
        np.testing.assert_allclose(np.sort(mesh.position[found, 1]), at)
        assert (mesh.position[found, 0] == 0).all()


def places(training, keep=slice(None)):
    pool = training.candidates
    return {tuple(x) for x in pool.position[pool.first][keep].round(9)}


def test_a_face_that_is_named_takes_its_facets_and_the_clearance_around_them(beam):
    """The seat is [0.3, 0.7] × [0.03, 0.07] m at z = 0.08 m: nothing is left on it or nearer to it than the clearance."""
    clearance = 0.012
    low, high = np.array([0.3, 0.03, 0.08]), np.array([0.7, 0.07, 0.08])
    every, _ = beam("gauges.clearance=none")
    x = every.candidates.position[every.candidates.first]
    inside = np.all((x > low - 1e-9) & (x < high + 1e-9), axis=1)
    assert np.count_nonzero(inside) == 2 * 4 * 4
    pool, bare = beam("gauges.clearance=none", "gauges.exclude=[seat]")
    assert places(pool) == places(every, ~inside)
    assert not np.any(bare.reason == "clearance")
    _, plain = beam(f"gauges.clearance={clearance}")
    pool, found = beam(f"gauges.clearance={clearance}", "gauges.exclude=[seat]")
    y = pool.candidates.position[pool.candidates.first]
    near = np.linalg.norm(np.maximum(np.maximum(low - y, y - high), 0), axis=1) < clearance
    alone = plain.reason[~inside] != "clearance"
    np.testing.assert_array_equal(found.reason != "clearance", alone & ~near)
    assert np.any(near & alone)
    assert found.clearance.near["faces"] == np.count_nonzero(near)


def test_zones_by_name_include_and_limit_too_and_a_name_that_is_not_there_is_named(beam):
    every, _ = beam("gauges.clearance=none")
    pool, _ = beam("gauges.clearance=none", "gauges.include=[seat]")
    others, _ = beam("gauges.clearance=none", "gauges.exclude=[seat]")
    assert places(pool) == places(every) - places(others)
    with pytest.raises(UserError, match="the mesh has no face, element set or node set 'seta'") as caught:
        beam("gauges.exclude=[seta]")
    assert caught.value.key == "gauges.exclude.0"
    assert caught.value.remedy == "did you mean seat?"


ON_SEAT = "loads.tip.set=seat", "loads.tip.node=null"
EVERYWHERE = "gauges.allow=[enclosed, bores, loaded]"


def test_all_candidates_of_a_part_without_inaccessible_places_stay(beam):
    """No other part lies on the beam: what the three rules could exclude changes nothing, to the last digit."""
    for default, every in zip(beam(), beam(EVERYWHERE), strict=True):
        for name in ("kept", "reason", "snr", "noise_std", "installation") if hasattr(default, "kept") else ("rows",):
            np.testing.assert_array_equal(getattr(default, name), getattr(every, name))


def test_facets_under_a_force_carry_no_gauge_and_those_under_a_pressure_do(beam):
    """The seat: 4 × 4 facets, with two gauges each, of which all nodes are loaded; the clearance is less than half a facet."""
    training, screened = beam(*ON_SEAT, "gauges.clearance=0.001")
    x = training.candidates.position[training.candidates.first]
    seat = (np.abs(x[:, 0] - 0.5) < 0.151) & (np.abs(x[:, 1] - x[:, 1].mean()) < 0.0151) & (x[:, 2] > x[:, 2].max() - 1e-6)
    assert np.count_nonzero(seat) == 32
    np.testing.assert_array_equal(screened.reason == "loaded", seat)
    _, pressed = beam(*ON_SEAT, "gauges.clearance=0.001", "loads.tip.direction=null", "loads.tip.pressure=true")
    assert not np.any(pressed.reason == "loaded")
    _, kept = beam(*ON_SEAT, "gauges.clearance=0.001", "gauges.allow=[loaded]")
    assert not np.any(kept.reason == "loaded")
