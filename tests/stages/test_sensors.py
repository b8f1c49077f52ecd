"""Layouts of strain gauges, rosettes, accelerometers and displacement sensors, within the limits a config states."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from strainsight.errors import StrainsightError

from ..shared import made, without_hot_spots
from .conftest import ROOT, SHORT

pytestmark = pytest.mark.usefixtures("no_hot_spots")
DECK = ROOT / "meshes" / "cantilever-coarse.bdf"

MIXED = """
kind: placement
name: mixed
mesh: {file: MESH}
parameters:
  E: {property: youngs_modulus, region: 1, guess: 1.89e+11, range: [1.6e+11, 2.4e+11]}
  rho: {property: density, region: 1, guess: 7850, range: [7000, 9000]}
loads:
  tip: {node: 2, direction: [0, 0, 1], known: false, signal: {type: sine, frequency: 30.0, amplitude: 1.0e+4}}
damping: {type: modal, ratio: 0.01}
train: {duration: 0.1, time_step: 5.0e-4}
gauges:
  direction: {type: axis, axis: [1, 0, 0], angles: [0, 45, 90]}
  rosette: true
  grid_length: 0.004
  range: 5.0e-3
  noise_std: {relative_to_strongest: 0.01}
  fixed: [{position: [0.3, 0.02, 0.096], direction: [1, 0.02, 0], length: 0.006}]
motion_sensors:
  acc: {quantity: acceleration, every: 0.1, noise_std: {value: 0.5}, price: 3}
  laser: {quantity: displacement, axes: [[0, 0, 1]], every: 0.2, noise_std: {value: 1.0e-4}, price: 10}
screen: {keep: 24}
place:
  estimate: [tip, E]
  keep: 5
  instants: 2
  certificate: false
  parameter_samples: 2
  minimum_spacing: 0.3
  budget: 9
  at_most: [{zone: {box: [[0, -1, -1], [0.35, 1, 1]]}, count: 1}]
validate:
  truth: {model: perturbed, parameters: {E: 2.0e+11}, modes: 12}
  time_step: 5.0e-4
  duration: 0.05
  initial_std: {tip: 0.1, E: 0.1}
  random_sets: 0
  repeats: 1
  noise_factors: []
filter: {compare: false}
"""


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    """stage → Artefact of the config above, up to place."""
    config = tmp_path_factory.mktemp("mixed") / "mixed.yaml"
    config.write_text(MIXED.replace("MESH", str(DECK)))
    with without_hot_spots():
        return made(config, until="place", beside="mixed")


def test_a_layout_keeps_every_limit_and_a_rosette_is_one_gauge_of_three_channels(mixed):
    train, place = mixed["train"], mixed["place"]
    chosen = place["/selected/final/channel"]
    first = chosen[:, 0]
    position, array, bonded = (train[f"/gauges/{key}"][first] for key in ("position", "array", "glued"))
    assert 2 <= len(chosen) <= 5
    assert all(np.linalg.norm(a - b) >= 0.3 * (1 - 1e-9) for a, b in combinations(position, 2))
    assert np.sum(position[:, 0] <= 0.35) == 1
    assert np.where(bonded, 0.0, np.array([1.0, 3.0, 10.0])[array]).sum() <= 9
    assert bonded.sum() == 1
    rosettes = chosen[(chosen >= 0).sum(axis=1) == 3]
    assert len(rosettes)
    for own in rosettes:
        assert len(np.unique(train["/gauges/gauge"][own])) == 1
        assert np.ptp(train["/gauges/position"][own], axis=0).max() == 0
        assert train["/gauges/angle"][own].tolist() == [0, 45, 90]


def test_a_bonded_gauge_is_snapped_and_stays(mixed):
    train = mixed["train"]
    assert train["/glued/distance"] == pytest.approx([0.001], rel=1e-9)
    np.testing.assert_allclose(train["/gauges/position"][0], [0.3, 0.02, 0.095], atol=1e-12)
    assert train["/gauges/length"][0] == 0.006
    assert 0 in mixed["screen"]["/kept"]
    assert 0 in mixed["place"]["/selected/final/number"]
    assert any("is already bonded" in sentence for sentence in mixed["place"]["/advice"])


def test_the_stored_scenarios_give_the_trace_of_the_layout(mixed):
    """From F, H, Q, R and weight of the file, by scipy's solver."""
    place = mixed["place"]
    own = np.isin(place["/pool/row"], place["/selected/final/gauge"])
    traces = []
    for F, H, Q, R, W in zip(*(place[f"/augmented/{key}"] for key in ("F", "H", "Q", "R", "weight")), strict=True):
        # Strain and motion have readings of different size: rows at unit noise suit the solver.
        rows = H[own] / np.sqrt(R[own])[:, None]
        traces.append(W @ np.diag(solve_continuous_are(F.T, rows.T, Q, np.eye(len(rows)))))
    assert len(traces) == 4
    assert np.mean(traces) == pytest.approx(place.summary["trace_final"], rel=1e-5)


def test_training_accelerations_are_second_differences_of_displacements(mixed):
    train = mixed["train"]
    moving = train["/gauges/quantity"] == 1
    z = train["/coordinate"] @ train["/gauges/row"][moving].T
    h = train["/time"][1]
    read = train["/acceleration"] @ train["/gauges/row"][moving].T
    second = (z[2:] - 2 * z[1:-1] + z[:-2]) / h**2
    # Of a component at f: 1 − (2πfh)²/12, 4 % at 220 Hz, of which there is little.
    error = np.abs(second - read[1:-1]).max() / np.abs(second).max()
    assert error < 0.05


@pytest.mark.slow
def test_the_filter_takes_all_of_them(mixed, tmp_path):
    (tmp_path / "mixed.yaml").write_text(MIXED.replace("MESH", str(DECK)))
    with without_hot_spots():
        validate = made(tmp_path / "mixed.yaml", until="validate", beside="mixed")["validate"]
    chosen = mixed["place"]["/selected/final/channel"]
    assert validate["/gauge/measured"].shape[1] == (chosen >= 0).sum()
    # with no load known E rests on what is stated of the tip's, and no error of it is right or wrong
    assert "the estimates of E depend on the process_noise of tip" in mixed["place"].summary["rests_on_loads"]


def test_an_array_over_channels_has_the_units_of_what_they_measure(mixed):
    assert mixed["train"].attributes("/rms")["units"] == "strain or m/s^2 or m"
    assert mixed["place"].attributes("/augmented/R")["units"] == "(unit of the channel)^2 s"
    assert mixed["train"].attributes("/gauges/row")["units"] == "(strain or m)/(kg^1/2 m)"


COARSE = (f"mesh.file={DECK}", *SHORT, "screen.keep=24", "place.certificate=false")


@pytest.fixture(scope="module")
def youngs(config):
    """A run of the example with other settings; all take the same reduced model over."""

    def run_with(*overrides, until="place"):
        with without_hot_spots():
            return made(config, *COARSE, *overrides, until=until, beside="sensors")

    return run_with


def test_a_plane_of_symmetry_places_mirrored_pairs_that_keep_their_spacing(youngs):
    place = youngs("place.symmetry={normal: [0, 0, 1]}", "place.keep=4", "place.minimum_spacing=0.15")["place"]
    position = place["/selected/final/position"]
    mirrored = position * [1, 1, -1]
    assert np.linalg.norm(position[:, None] - mirrored[None], axis=2).min(axis=1).max() < 1e-9
    assert len(np.unique(place["/selected/final/gauge"])) < len(position) in (3, 4)
    assert min(np.linalg.norm(a - b) for a, b in combinations(position, 2)) >= 0.15 * (1 - 1e-9)


def test_the_metric_uses_the_input_model_of_the_filter():
    config = ROOT / "configs" / "cantilever-input.yaml"
    walk = "loads.tip.process_noise={model: integrated_random_walk}"
    with without_hot_spots():
        done = made(config, *COARSE, walk, "parameters.E.guess=2.0e+11", until="place")
    place, n = done["place"], done["rom"]["/basis"].shape[1]
    scale, weight = place["/augmented/scale"][0], place["/augmented/weight"][0]
    F = place["/augmented/F"][0] * scale[:, None] / scale
    assert place["/augmented/state"].tolist()[2 * n :] == ["tip", "rate of tip"]
    np.testing.assert_allclose(F[:n], np.eye(n, 2 * n + 2, n), atol=1e-12)
    assert F[2 * n, 2 * n + 1] == pytest.approx(2 * np.pi * 20.0, rel=1e-9)
    assert weight[2 * n] > 0
    assert weight[2 * n + 1] == 0


@pytest.mark.parametrize(
    ("override", "key", "says"),
    [
        ("place.minimum_spacing=1.5", "place.minimum_spacing", "allows only"),
        ("gauges.include=[{box: [[5, 5, 5], [6, 6, 6]]}]", "gauges.include", "no admissible facet remains"),
        ("gauges.fixed=[{position: [0.3, 0.5, 0.095], direction: [1, 0, 0]}]", "gauges.fixed.0", "from the surface"),
        ("gauges.range=1.0e-9", "gauges.range", "range"),
        ("place.symmetry={point: [0, 0, 0.3], normal: [0, 0, 1]}", "place.symmetry", "mirror"),
    ],
)
def test_a_request_that_nothing_meets_names_the_limit(youngs, override, key, says):
    with pytest.raises(StrainsightError) as caught:
        youngs(override)
    assert caught.value.exit_code == 2
    assert key in str(caught.value)
    assert says in str(caught.value)


def test_the_order_of_sensors_in_a_config_is_none(mixed, tmp_path):
    """Two configs that differ by it are the same, so a cached artefact of one has to serve the other."""
    lines = MIXED.replace("MESH", str(DECK)).splitlines()
    acc = next(i for i, line in enumerate(lines) if line.startswith("  acc:"))
    lines[acc], lines[acc + 1] = lines[acc + 1], lines[acc]
    config = tmp_path / "mixed.yaml"
    config.write_text("\n".join(lines))
    again = made(config, until="screen")
    for stage, dataset in (("train", "/gauges/quantity"), ("train", "/gauges/array"), ("screen", "/noise_std")):
        np.testing.assert_array_equal(again[stage][dataset], mixed[stage][dataset])


@pytest.mark.slow
def test_a_bonded_gauge_in_a_loud_place_leaves_the_noise_of_others(youngs):
    """The root strains most; a gauge bonded there is no candidate, of whose strongest the noise is a share."""
    zone = "gauges.exclude=[{box: [[-1, -1, -1], [1.0, 1, 1]]}]"
    bonded = "gauges.fixed=[{position: [0.1, 0.0, 0.095], direction: [1, 0, 0]}]"
    screened = (youngs(*own, until="screen")["screen"] for own in ((zone,), (zone, bonded)))
    quiet, loud = (screen.summary["noise_std"] for screen in screened)
    assert loud == pytest.approx(quiet, rel=1e-12)


def test_a_zone_in_the_wrong_unit_is_noticed(youngs):
    """A box in millimetres takes no facet of a beam of two metres."""
    train = youngs("gauges.exclude=[{box: [[500, -100, -100], [600, 100, 100]]}]", until="train")["train"]
    assert "no surface facet in the zone gauges.exclude.0" in train.message
    assert "in metres" in train.message
