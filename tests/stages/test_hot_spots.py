"""Gauges of a layout that sit at a hot spot are named, with how much their strain changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

from strainsight import api
from strainsight.cases.structure.hot_spots import SHARE, at_guess, hot_spot_advice, share_of
from strainsight.cases.structure.placed import placement_output
from strainsight.records.placed import HotSpots

from ..edges.beam import PLACEMENT_CONFIG, SIZE, E, bricks

CELLS = (20, 4, 4)


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """A beam held at x = 0, and a force on one node in the middle of its top, beside which a gauge is bonded."""
    folder = tmp_path_factory.mktemp("beam")
    (folder / "beam.bdf").write_text(bricks(CELLS, "hex20", tip=False), encoding="ascii")
    config = yaml.safe_load(yaml.safe_dump(PLACEMENT_CONFIG))
    config["rom"]["modes"] = 6
    config["gauges"]["exclude"] = [{"normal_cone": {"axis": [1, 0, 0], "angle": 20}}]
    (folder / "edge.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    step = np.array(SIZE) / CELLS
    point = np.array([10 * step[0], 2 * step[1], SIZE[2]])
    beside = [*(point[:2] + 0.5 * step[:2]), SIZE[2]]
    first = api.load(folder / "edge.yaml", ["loads.tip.node=1", "screen.keep=30"])
    mesh = api.mesh(first)
    node = int(mesh.node_ids[np.argmin(np.linalg.norm(mesh.position - point, axis=1))])
    case = api.load(
        folder / "edge.yaml",
        [f"loads.tip.node={node}", "loads.tip.direction=[0, 0, 1]", "screen.keep=30", "place.keep=3",
         f"gauges.fixed=[{{position: [{beside[0]}, {beside[1]}, {beside[2]}], direction: [1, 0, 0]}}]"],
    )  # fmt: skip
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, mesh, reduced, training)
    return case, mesh, reduced, training, api.place(case, mesh, reduced, training, screened)


def test_the_gauge_beside_a_load_on_one_node_is_named_and_the_others_are_not(beam):
    case, mesh, reduced, training, placed = beam
    listed, test = placed.listed, placed.hot_spots
    np.testing.assert_array_equal(test.hot, listed.bonded)
    at = int(np.flatnonzero(listed.bonded)[0])
    named = [text for text in placed.advice if "hot spot" in text]
    assert len(named) == 1
    assert named[0].startswith(f"{listed.labels[at]} sits at a hot spot")
    assert "refined" in named[0] or "spread" in named[0]
    assert "move it" not in named[0]
    again = api.hot_spots(case, mesh, reduced, training, placed.gauges)
    np.testing.assert_array_equal(again.refined, test.refined)


def test_gauges_at_hot_spots_of_one_kind_share_a_sentence():
    test = HotSpots(refined=np.array([0.2, 0.2, 0.01, -0.3]), spread=np.zeros(4), share=0.05)
    said = list(hot_spot_advice(test, ["G1", "G2", "G3", "G4"], [False] * 4))
    assert said == [
        "G1, G2 sit at hot spots: their strain changes by +20 % when the mesh around it is refined; "
        "move them (a larger gauges.clearance, gauges.exclude) or mesh more finely there.",
        "G4 sits at a hot spot: its strain changes by -30 % when the mesh around it is refined; "
        "move it (a larger gauges.clearance, gauges.exclude) or mesh more finely there.",
    ]


def test_it_is_in_the_record_the_tables_and_the_summary(beam):
    _, mesh, _, _, placed = beam
    output = placement_output(placed, mesh, "m")
    np.testing.assert_array_equal(output.datasets["/hot_spots/refined"].array, placed.hot_spots.refined)
    assert output.summary["hot_spots"] == 1
    (table,) = (own for own in output.tables if "hot spots" in own.title)
    assert [row[-1] for row in table.rows] == ["hot spot" if hot else "" for hot in placed.hot_spots.hot]


def test_the_moduli_are_those_of_the_guess_and_uniform_ones_do_not_matter(beam):
    """E of the deck is the truth, the guess a tenth lower; strain changes alike in a part of one material."""
    case, mesh, reduced, training, placed = beam
    own = at_guess(case.config, mesh, reduced)
    (region,) = own.regions.values()
    assert own.materials[region.material].youngs_modulus == pytest.approx(0.9 * E)
    assert own.materials[region.material].poisson_ratio == mesh.materials[1].poisson_ratio
    stiff = replace(reduced, model=replace(reduced.model, reference={"E": 7e10}))
    again = api.hot_spots(case, mesh, stiff, training, placed.gauges)
    np.testing.assert_allclose(again.refined, placed.hot_spots.refined, rtol=1e-6, atol=1e-9)


def test_the_share_is_five_per_cent_or_what_gains_are_allowed(beam):
    config = beam[0].config
    assert share_of(config) == SHARE
    wide = config.model_copy(update={"tolerances": config.tolerances.model_copy(update={"gain": 0.08})})
    assert share_of(wide) == 0.08


def test_sentences_say_both_changes_and_who_was_not_tested():
    test = HotSpots(refined=np.array([0.01, -0.23, np.nan]), spread=np.array([0.3, 0.0, np.nan]), share=SHARE)
    first, second, third = hot_spot_advice(test, ("G1", "G2", "G3"), (False, False, False))
    assert "G1" in first
    assert "+30 % when forces" in first
    assert "refined" not in first
    assert "-23 % when the mesh around it is refined" in second
    assert "move it" in second
    assert "G3" in third
    assert not list(hot_spot_advice(None, ("G1",), (False,)))
