"""Gauges at hot spots, and what is to be looked at where gauges are bonded."""

from __future__ import annotations

import csv
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight import api
from strainsight.experiment.layout.gauge_list import deck_frame
from strainsight.experiment.layout.output import gauge_csv
from strainsight.experiment.structure.bonded_gauges import read_bonded
from strainsight.experiment.structure.clearance import HAND, IN_PLACE, OVER_GRID, _steep, at_guess, notes_at_gauges
from strainsight.mesh.facets import exterior_facets
from strainsight.records.placed import AtGauges
from strainsight.sensors.candidates import candidates
from strainsight.sensors.surface_paths import skin_of
from strainsight.sensors.zones import NormalCone

from ..bodies import body
from ..edges.beam import SIZE, E, bricks, placed, prepared

CELLS = (12, 4, 4)


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """A beam held at x = 0, and a force on one node in the middle of its top, beside which a gauge is bonded."""
    step = np.array(SIZE) / CELLS
    point = np.array([6 * step[0], 2 * step[1], SIZE[2]])
    beside = [*(point[:2] + 0.5 * step[:2]).tolist(), SIZE[2]]
    text = bricks(CELLS, "hex20", tip=False)
    grid = [line.split(",") for line in text.splitlines() if line.startswith("GRID")]
    node = next(int(card[1]) for card in grid if np.allclose([float(x) for x in card[3:]], point))
    changes = {
        "rom.modes": 6,
        "gauges.exclude": [{"normal_cone": {"axis": [1, 0, 0], "angle": 20}}],
        "gauges.fixed": [{"position": beside, "direction": [1, 0, 0]}],
        "loads.tip.node": node,
        "loads.tip.direction": [0, 0, 1],
        "screen.keep": 30,
        "place.keep": 3,
    }
    own = prepared(tmp_path_factory.mktemp("beam"), text, changes)
    return own, placed(own)


def test_the_gauge_with_a_load_on_one_node_is_named_and_the_others_are_not(beam):
    _, found = beam
    listed = found.listed
    np.testing.assert_array_equal(found.hot_spots.hot, listed.bonded)
    (at,) = np.flatnonzero(listed.bonded)
    (named,) = [text for text in found.advice if "Hot spot" in text]
    assert named.startswith(f"Hot spot below {listed.labels[at]}, because the strain changes by")
    assert "refined" in named or "spread" in named
    assert "move it" not in named


def test_the_moduli_are_those_of_the_guess_and_uniform_ones_do_not_matter(beam):
    """E of the deck is the truth, the guess a tenth lower; strain changes alike in a part of one material."""
    own, found = beam
    mesh = at_guess(own.structure)
    (region,) = mesh.regions.values()
    assert mesh.materials[region.material].youngs_modulus == pytest.approx(0.9 * E)
    assert mesh.materials[region.material].poisson_ratio == own.mesh.materials[1].poisson_ratio
    stiff = replace(own.reduced, model=replace(own.reduced.model, reference={"E": 7e10}))
    again = api.hot_spots(own.case, own.mesh, stiff, own.training, found.gauges)
    np.testing.assert_allclose(again.refined, found.hot_spots.refined, rtol=1e-6, atol=1e-9)


SIGMA, LENGTH = 0.002, 0.006


@pytest.fixture(scope="module")
def bar():
    """0.4 × 0.05 × 0.05 m in hex20, moved so that ε_xx = x/m: u = x²/2."""
    mesh = body("hex20", (8, 2, 2), lambda u, v, w: (0.05 * u, 0.025 * v, 0.025 * w))
    field = np.zeros((len(mesh.position), 3))
    field[:, 0] = 0.5 * mesh.position[:, 0] ** 2
    return mesh, SimpleNamespace(basis=field.reshape(-1, 1))


def steep(bar, angles, rosette=False, bonded=False):
    """Changes in place and over the grid of gauges on the top, away from its ends, and x of each [m]."""
    mesh, reduced = bar
    facets = exterior_facets(mesh)
    every = candidates(
        mesh, facets, (1, 0, 0), angles, include=[NormalCone((0, 0, 1), 5.0)], rosette=rosette, length=LENGTH
    )
    part = every.take(np.flatnonzero(np.abs(every.position[:, 0] - 0.2) < 0.13))
    part.bonded[:] = bonded
    training = SimpleNamespace(moment=np.eye(1))
    tolerances, skin = SimpleNamespace(position=SIGMA), skin_of(mesh.position, facets)
    structure = SimpleNamespace(mesh=mesh, reduced=reduced, training=training, tolerances=tolerances, skin=skin)
    found = _steep(structure, part)
    return *found, part.position[part.first, 0]


@pytest.mark.parametrize("theta", [0.0, 30.0])
def test_of_a_strain_that_grows_along_a_bar_both_changes_are_in_closed_form(bar, theta):
    """ε_d = x cos²θ: σ/x in place, L cos θ/x over the grid."""
    in_place, over_grid, x = steep(bar, (theta,))
    np.testing.assert_allclose(in_place, SIGMA / x, rtol=1e-6)
    np.testing.assert_allclose(over_grid, LENGTH * np.cos(np.deg2rad(theta)) / x, rtol=1e-6)


def test_of_a_rosette_the_channel_counts_that_changes_most_over_the_largest_reading(bar):
    in_place, over_grid, x = steep(bar, (90.0, 45.0, 0.0), rosette=True)
    assert len(in_place) * 3 > len(x) > 0
    np.testing.assert_allclose(in_place, SIGMA / x, rtol=1e-6)
    np.testing.assert_allclose(over_grid, LENGTH / x, rtol=1e-6)


def test_a_channel_that_reads_nothing_but_rounding_hides_no_other(bar):
    """ε_xx is x times what cancels in the motion of training, ε_yy is y: L/y over the grid of the channel across."""
    mesh, reduced = bar
    y = mesh.position[:, 1] + 0.02
    across = np.zeros((len(y), 3))
    across[:, 1] = 0.5 * y**2
    rng = np.random.default_rng(0)
    motion, b = rng.standard_normal((2, 6))
    b -= (b @ motion) / (motion @ motion) * motion
    basis = np.hstack([reduced.basis * b, across.reshape(-1, 1)])
    moment = np.outer([*motion, 1.0], [*motion, 1.0])
    facets = exterior_facets(mesh)
    part = candidates(mesh, facets, (1, 0, 0), (0.0, 90.0), include=[NormalCone((0, 0, 1), 5.0)], rosette=True, length=LENGTH)
    training, skin = SimpleNamespace(moment=moment), skin_of(mesh.position, facets)
    tolerances, reduced = SimpleNamespace(position=SIGMA), SimpleNamespace(basis=basis)
    structure = SimpleNamespace(mesh=mesh, reduced=reduced, training=training, tolerances=tolerances, skin=skin)
    _, over_grid = _steep(structure, part)
    np.testing.assert_allclose(over_grid, LENGTH / (part.position[part.first, 1] + 0.02), rtol=1e-6)


def test_a_gauge_that_is_bonded_is_in_its_place(bar):
    in_place, over_grid, x = steep(bar, (0.0,), bonded=True)
    assert not in_place.any()
    np.testing.assert_allclose(over_grid, LENGTH / x, rtol=1e-6)


NOTED = AtGauges(
    in_place=np.array([0.01, 0.081, 0.02, np.nan]),
    over_grid=np.array([0.02, 0.25, 0.03, np.nan]),
    room=np.array([np.inf, np.inf, 0.012, 0.06]),
    lies_on=("", "", "", "the face at (0, 0, 0) m has 4 supported bores"),
    in_place_limit=IN_PLACE,
    over_grid_limit=OVER_GRID,
    room_limit=HAND,
)


def test_each_note_has_its_number_and_its_limit():
    quiet, steep_one, tight_one, sensor = notes_at_gauges(NOTED, 4)
    assert quiet == ""
    in_place = "8.1 % strain change over one standard deviation of the gauge position (limit 5 %)"
    assert steep_one == f"steep gradient: {in_place} and 25 % strain change along the measuring grid (limit 20 %)"
    assert tight_one == "check access: free height above the gauge 12 mm (limit 60 mm)"
    room = "free height above the gauge 60 mm (limit 60 mm)"
    assert sensor == f"check access: {room}, and the face at (0, 0, 0) m has 4 supported bores"
    assert notes_at_gauges(replace(NOTED, room=np.full(4, np.inf)), 4)[2] == ""


def test_notes_are_the_last_column_of_the_file_where_there_are_some_and_it_is_read_as_before(beam, tmp_path):
    own, found = beam
    of_deck = found.expected, own.mesh, deck_frame("m")
    assert b"notes" not in gauge_csv(found.listed, *of_deck)
    notes = ["", notes_at_gauges(NOTED, 4)[1], ""]
    (tmp_path / "gauges.csv").write_bytes(gauge_csv(replace(found.listed, notes=tuple(notes)), *of_deck))
    with (tmp_path / "gauges.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0])[-1] == "notes"
    assert [row["notes"] for row in rows] == notes
    assert list(read_bonded(tmp_path / "gauges.csv")) == list(found.listed.labels)
