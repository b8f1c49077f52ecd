"""Screening for a type of gauge: its clearance, its spacing, and what bends too tightly for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight import api
from strainsight.errors import InfeasibleError
from strainsight.experiment.structure.clearance import bent_gauges, bent_warning, clearance_of
from strainsight.experiment.structure.structure import Structure
from strainsight.mesh.facets import exterior_facets, facet_key
from strainsight.sensors.screening import BEND
from strainsight.sensors.surface import facet_centres

from ..edges.beam import SIZE, bricks, prepared

INNER = 0.2
"""[m] to which the beam is curled, its outside to `SIZE[2]` more."""
OWN = "{grid_length: 0.002, grid_width: 0.002, carrier_length: 0.01, carrier_width: 0.006, resistance: 350, bend_radius: %g}"


def tight(radius):
    """A type of gauge that may be bent to this radius [m] and no tighter."""
    return "gauges.type=mine", f"gauges.types={{mine: {OWN % radius}}}"


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """The beam of the tests of clearance, of bricks of 0.1 × 0.01 × 0.01 m; `load` takes overrides."""
    folder = tmp_path_factory.mktemp("beam")
    own = prepared(folder, bricks((10, 10, 8)), {"screen": {"keep": "all"}, "place.keep": 2})
    own.load = lambda *overrides: api.load(folder / "edge.yaml", overrides)
    return own


@pytest.fixture(scope="module")
def training(beam):
    return beam.training


def test_clearance_and_spacing_are_those_of_the_carrier(beam):
    """Half of √(10.7² + 6.9²) mm from the edges along the beam, and 10.7 mm between any two that are kept."""
    case = beam.load("gauges.type=3/350")
    training = api.train(case, beam.mesh, beam.reduced)
    assert np.all(training.candidates.length == 0.00318)
    found = api.screen(case, beam.mesh, beam.reduced, training)
    assert found.clearance.distance == found.clearance.wanted == pytest.approx(0.5 * np.hypot(0.0107, 0.0069))
    x = training.candidates.position[training.candidates.first][found.kept]
    apart = np.linalg.norm(x[:, None] - x[None], axis=2) + np.eye(len(x))
    assert apart.min() >= 0.0107
    plain = api.screen(beam.case, beam.mesh, beam.reduced, training)
    assert len(found.kept) < len(plain.kept)
    assert np.all(found.range[training.candidates.quantity == 0] == 0.05)
    stated = api.screen(beam.load("gauges.type=3/350", "gauges.clearance=0.005"), beam.mesh, beam.reduced, training)
    assert (stated.clearance.distance, stated.clearance.rule) == (0.005, "stated")


def curled(mesh):
    """Rolled up along x: its inside, z = 0, at 0.2 m from an axis along y, its outside at 0.28 m, cells of 0.5 rad."""
    x, y, z = (mesh.position - mesh.position.min(axis=0)).T
    return replace(mesh, position=np.column_stack([(INNER + z) * np.sin(x / INNER), y, (INNER + z) * np.cos(x / INNER)]))


def test_what_bends_tighter_than_the_type_may_is_left_out_and_nothing_else(beam, training):
    """Of a radius of 0.24 m: the inside but for its ends, of which half is seen beside an edge; not outside and flanks."""
    case, mesh = beam.load(*tight(0.24), "gauges.clearance=none"), curled(beam.mesh)
    place = training.candidates.position[training.candidates.first] - beam.mesh.position.min(axis=0)
    found = api.screen(case, mesh, beam.reduced, training)
    inside = (place[:, 2] == 0) & (place[:, 0] > 0.1) & (place[:, 0] < SIZE[0] - 0.1)
    assert np.count_nonzero(inside) > 100
    np.testing.assert_array_equal(found.reason == BEND, inside)
    assert not np.isin(np.flatnonzero(inside), found.kept).any()
    wide = beam.load(*tight(0.19), "gauges.clearance=none")
    assert not np.any(api.screen(wide, mesh, beam.reduced, training).reason == BEND)


def test_with_such_a_bend_a_gauge_keeps_its_clearance(beam, training):
    """The flanks at the inside are nearer than half the carrier's diagonal to it, and that counts as `bends`."""
    case, mesh = beam.load(*tight(0.24)), curled(beam.mesh)
    pool = training.candidates
    facets = exterior_facets(mesh)
    centre, _ = facet_centres(mesh.position, facets.kind, facets.nodes)
    moved = replace(pool, position=centre[np.searchsorted(facets.key, facet_key(pool.element, pool.facet))])
    found = api.screen(case, mesh, beam.reduced, replace(training, candidates=moved))
    assert found.clearance.near["bends"] > np.count_nonzero(found.reason == BEND) > 0
    flat = api.screen(case, beam.mesh, beam.reduced, training)
    assert flat.clearance.near["bends"] == 0


def test_what_bends_too_tightly_is_no_place_that_a_clearance_leaves(beam, training):
    """Of two candidates one lies on a bend, more than 2 mm from all its sides and diagonals, the other on a flank, 0.5 mm from
    its edge: a clearance of 1 mm leaves neither."""
    pool, facets, mesh = training.candidates, exterior_facets(beam.mesh), curled(beam.mesh)
    x, y, z = (pool.position - beam.mesh.position.min(axis=0)).T
    half = np.abs(x - 0.55) < 1e-9
    inside = np.flatnonzero(half & (z == 0) & (np.abs(y - 0.045) < 1e-9))[0]
    flank = np.flatnonzero(half & (y == 0) & (z > 0.07))[0]
    moved = pool.position.copy()
    for i, axis, share in ((inside, 0, 0.75), (flank, 2, 0.95)):
        corners = facets.nodes[np.searchsorted(facets.key, facet_key(pool.element[i : i + 1], pool.facet[i : i + 1])[0]), :4]
        far = beam.mesh.position[corners, axis] > pool.position[i, axis]
        moved[i] = np.where(far, share / 2, (1 - share) / 2) @ mesh.position[corners]
    own = replace(pool, position=moved)
    case = beam.load(*tight(0.24), "gauges.clearance=0.001")
    structure = Structure(case.config, {}, mesh, beam.reduced, training)

    def clearance_at(places):
        few = replace(structure, training=replace(training, candidates=own.take(np.array(places))))
        return clearance_of(few, np.zeros(len(places), dtype=bool))

    for i, near in ((inside, "bends"), (flank, "edges")):
        with pytest.raises(InfeasibleError, match=r"1 mm from every edge, support, load and surface with a radius too small for"):
            clearance_at([i])
        found, blocked = clearance_at([i, np.flatnonzero(half & (y == 0) & (np.abs(z - 0.045) < 1e-9))[0]])
        assert ({name for name, count in found.near.items() if count}, blocked.tolist()) == ({near}, [True, False])
    with pytest.raises(InfeasibleError, match="none of 2 candidates"):
        clearance_at([inside, flank])


def test_one_that_is_bonded_there_is_kept_with_a_warning(beam):
    along = "direction: [1, 0, 0]"
    fixed = f"[{{name: K1, position: [0.45, 0.045, 0.0], {along}}}, {{position: [0.45, 0.045, 0.08], {along}}}]"
    case = beam.load(*tight(0.24), f"gauges.fixed={fixed}", "gauges.snap_tolerance=0.1", "place.installation=ignore")
    training, mesh = api.train(case, beam.mesh, beam.reduced), curled(beam.mesh)
    found = api.screen(case, mesh, beam.reduced, training)
    assert {0, 1} <= set(found.kept.tolist())
    structure = Structure(case.config, {}, mesh, beam.reduced, training)
    said = bent_warning(structure, bent_gauges(structure))
    assert "K1" in said
    assert "fixed 2" not in said
    assert bent_warning(structure, bent_gauges(replace(structure, mesh=beam.mesh))) == ""
