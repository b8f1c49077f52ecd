"""Loads that act otherwise than the filter believes, zeros that drift, gauges that may be turned: against drawn truths."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from strainsight import api
from strainsight.estimation.conditional import linear_models
from strainsight.experiment.structure.considered import build_considered, on_average, tolerated
from strainsight.experiment.structure.consistency import build_check_record, turning_of
from strainsight.experiment.structure.problem import filter_model, problem_of
from strainsight.experiment.structure.reduction import full_model
from strainsight.experiment.structure.references import parameters_of
from strainsight.experiment.structure.truth import installation_of, load_error_of
from strainsight.fem.loads import axes_across
from strainsight.fem.model import nodal
from strainsight.mesh.facets import exterior_facets
from strainsight.sensors.strain_operator import channel_rows, misplaced

from ..edges.beam import TIP, E, bricks, prepared
from .drawn_truths import NOTHING, beam_in, spread, trial

SIDE = {
    "node": TIP,
    "direction": [0.0, 1.0, 0.3],
    "known": False,
    "signal": {"type": "sine", "frequency": 10.0, "amplitude": 100.0},
    "process_noise": {"model": "oscillator"},
}
ALL = {"load_angle": 2.0, "load_position": 0.004, "load_gain": 0.01}
SMALL = {"load_angle": 0.25, "load_position": 0.0005, "load_gain": 0.0025}
OF_E = {"tolerances": NOTHING | ALL}
OF_A_LOAD = OF_E | {
    "loads.side": SIDE,
    "parameters.E.guess": E,
    "place.estimate": ["side"],
    "validate.initial_std": {"side": 0.5},
}
SLOW = {"train": {"duration": 0.5, "time_step": 0.005}, "loads.tip.signal.frequency": 2.0}


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    return beam_in(tmp_path_factory.mktemp("beam"))


def strain_under(own, theta, force, moment, offset=None):
    """Strain of the channels under a force and a moment on TIP, by the full model; gauges are offset (gauges, 2) from their
    places."""
    parameters = parameters_of(own.case.config.parameters, own.mesh, {})
    model = full_model(own.case.config.mesh, own.mesh, parameters, {}).model
    node = own.mesh.node_index(TIP)
    row = model.constraint.reference_rows[node]
    e = np.zeros(model.constraint.transform.shape[0])
    e[3 * node : 3 * node + 3], e[row : row + 3] = force, moment
    z = spsolve(model.stiffness.at(theta).tocsc(), model.constraint.transform.T @ e)
    part, facets = own.training.candidates.take(own.channels), exterior_facets(own.mesh)
    if offset is not None:
        part, held = misplaced(own.mesh.position, part, facets, offset)
        assert not held.any()
    return channel_rows(own.mesh.position, part, nodal(model, z[:, None]), facets=facets)[:, 0]


def test_under_constant_loads_the_filter_expects_what_the_full_model_strains(beam):
    """Steady state of its step and its readings with one of every ν, for a known and an unknown load, against central
    differences of turned and shifted forces on the full model: 1e-6 of the change, though no coordinate holds all of it."""
    own = beam(OF_A_LOAD | {"loads.side": SIDE | {"process_noise": {"model": "random_walk"}}})
    model = filter_model(own.problem, own.channels, own.problem.h)
    considered = build_considered(own.tolerated, model, own.channels)
    one = ("load direction", "load direction", "load point", "load point")
    assert model.model.inputs == ("side", "tip")
    assert considered.source == (*one, *one, "load gain")
    linear = linear_models(model, np.zeros((1, 0)), considered)
    moving, w, h, theta = slice(0, 2 * model.model.size), 700.0, 1e-4, own.reduced.model.reference
    without_row = []

    def steady(push):
        """Motion that a constant push leads to."""
        return np.linalg.solve(np.eye(moving.stop) - linear.A[0][moving, moving], push[moving])

    for first, name in ((0, "side"), (4, "tip")):
        direction = np.array(own.case.config.loads[name].direction)
        direction = direction / np.linalg.norm(direction)
        x, known = np.zeros(linear.A.shape[1]), np.zeros(linear.G.shape[2])
        if name == "tip":
            known[0] = w
        else:
            x[model.position[0]] = w / model.amplitude[0]
        x[moving] = steady(linear.A[0] @ x + linear.G[0] @ known)
        for k, axis in enumerate((*axes_across(direction), *axes_across(direction))):
            change = np.zeros_like(x)
            change[moving] = steady(linear.A_nu[0, first + k] @ x + linear.G_nu[0, first + k] @ known)
            held = linear.H[0] @ change
            found = held + linear.D[first + k] @ x + linear.E[first + k] @ known[:1]
            if k < 2:
                ends = [Rotation.from_rotvec(sign * h * axis).apply(direction) for sign in (1, -1)]
                slope = strain_under(own, theta, (ends[0] - ends[1]) / (2 * h), np.zeros(3))
            else:
                slope = strain_under(own, theta, np.zeros(3), np.cross(axis, direction))
            expected = (np.deg2rad(2.0) if k < 2 else 0.004) * w * slope
            np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
            without_row.append(np.abs(held - expected).max() / np.abs(expected).max())
    assert max(without_row) > 0.01


def test_a_misplaced_gauge_reads_what_a_shifted_load_strains_there(tmp_path):
    """The product of both errors under a constant load, against mixed differences of the full model: 1e-6 of the largest, of
    which the coordinates alone miss a twentieth."""
    std = 0.002
    own = beam_in(tmp_path, "hex20")(OF_A_LOAD | {"tolerances": NOTHING | ALL | {"position": std}})
    model, theta = filter_model(own.problem, own.channels, own.problem.h), own.reduced.model.reference
    considered = build_considered(own.tolerated, model, own.channels)
    linear, w = linear_models(model, np.zeros((1, 0)), considered), 700.0
    assert considered.source[9:17] == ("position",) * 8
    moving, x, known = slice(0, 2 * model.model.size), np.zeros(linear.A.shape[1]), np.zeros(linear.G.shape[2])
    known[0] = w
    away = np.eye(moving.stop) - linear.A[0][moving, moving]
    x[moving] = np.linalg.solve(away, (linear.G[0] @ known)[moving])
    direction = np.array(own.case.config.loads["tip"].direction)
    direction = direction / np.linalg.norm(direction)
    of_coordinates, of_all, expected = [], [], []
    for k, axis in enumerate(axes_across(direction), start=6):
        change = np.zeros_like(x)
        change[moving] = np.linalg.solve(away, (linear.A_nu[0, k] @ x + linear.G_nu[0, k] @ known)[moving])
        beyond = np.eye(9)[k] * (linear.U @ x + linear.W @ known[:1])
        for way in range(2):
            # each of four gauges reads its own error alone
            of_gauges = slice(9 + 4 * way, 13 + 4 * way)
            of_coordinates.append((linear.D[of_gauges] @ change).sum(axis=0))
            of_all.append(of_coordinates[-1] + (linear.B[of_gauges] @ beyond).sum(axis=0))
            offset = np.tile(3**0.5 * std * np.eye(2)[way], (4, 1))
            ends = [strain_under(own, theta, np.zeros(3), np.cross(axis, direction), s * offset) for s in (1, -1)]
            expected.append(0.004 * w * (ends[0] - ends[1]) / (2 * 3**0.5))
    largest = np.abs(expected).max()
    np.testing.assert_allclose(of_all, expected, atol=1e-6 * largest)
    assert np.abs(np.array(of_coordinates) - expected).max() > 0.05 * largest


def test_a_gain_of_the_load_is_an_error_of_the_modulus_of_the_same_size(beam):
    """Strain is in proportion to F/E where the load is slow: 1 % of F is 1 % of E, but for (f/f₁)²."""
    own = beam(SLOW | {"tolerances": NOTHING | {"load_gain": 0.01}})
    found = api.expect(own.case, own.mesh, own.reduced, own.training, own.screened, own.gauges)
    part = found.budget["E"]["load gain"] * found.std["E"] ** 2
    assert np.sqrt(part) == pytest.approx(0.01, rel=3e-3)
    assert found.std["E"] > 0.01 * (1 - 3e-3)
    exact = beam(SLOW | {"tolerances": "none"})
    plain = api.expect(exact.case, exact.mesh, exact.reduced, exact.training, exact.screened, exact.gauges)
    # by the samples alone, the prior of E being 100 %; they tell gain and E apart by (f/f₁)² of a part in a thousand
    samples, plainly = (1 / (1 / own.std["E"] ** 2 - 1) for own in (found, plain))
    assert samples == pytest.approx(plainly + part * (samples / found.std["E"] ** 2) ** 2, rel=1e-4)


def test_a_truth_is_loaded_as_drawn(beam):
    """Of a slow load what turn, shift and gain of one realisation add is the static strain of that force on the full model."""
    changes = SLOW | {"validate.time_step": 0.005, "validate.duration": 0.5}
    own = beam(changes | {"tolerances": NOTHING | ALL})
    found, exact = trial(own), trial(beam(changes | {"tolerances": "none"}))
    theta, direction = {"E": E}, np.array(own.case.config.loads["tip"].direction)
    direction /= np.linalg.norm(direction)
    axes = axes_across(direction)
    plain = exact.reading(exact.chosen)
    force = 1000 * np.sin(4 * np.pi * found.time)
    for realisation in (1, 2):
        off = load_error_of(own.case.config, "tip", True, realisation)
        turned = Rotation.from_rotvec(off.turn @ axes).apply(direction)
        change = strain_under(own, theta, off.factor * turned, np.cross(off.shift @ axes, off.factor * turned))
        change -= strain_under(own, theta, direction, np.zeros(3))
        added = found.again(realisation) - plain
        np.testing.assert_allclose(added, np.outer(force, change), atol=0.01 * np.abs(added).max())


def test_a_load_is_drawn_by_its_name_the_seed_and_the_number_of_the_realisation(beam):
    """Another load beside it, or whether it is known, leaves its draws; they are normal with the σ of the tolerances."""
    one, two = (beam(changes).case.config for changes in (OF_E, OF_A_LOAD))
    for realisation in (0, 3):
        first, second = (load_error_of(config, "tip", True, realisation) for config in (one, two))
        np.testing.assert_array_equal(np.r_[first.turn, first.shift], np.r_[second.turn, second.shift])
        assert first.factor == second.factor
    unknown = load_error_of(two, "tip", False, 3)
    np.testing.assert_array_equal(unknown.shift, second.shift)
    assert unknown.factor == 1.0
    others = [load_error_of(two, "side", True, 3), load_error_of(two, "tip", True, 4),
              load_error_of(two.model_copy(update={"seed": 2}), "tip", True, 3)]  # fmt: skip
    assert all(np.abs(own.turn - second.turn).min() > 1e-6 for own in others)
    drawn = [load_error_of(two, "tip", True, r) for r in range(2000)]
    values = np.array([[*np.rad2deg(own.turn), *own.shift, own.factor - 1] for own in drawn])
    np.testing.assert_allclose(values.std(axis=0) / [2.0, 2.0, 0.004, 0.004, 0.01], 1.0, atol=0.06)
    assert np.abs(np.corrcoef(values.T) - np.eye(5)).max() < 0.1


ZEROS = {"drift": 4e-6, "temperature": 8.0, "thermal_output": 1e-6, "thermal_spread": 5e-7}
LARGE = ZEROS | {"drift": 1.2e-5, "temperature": 24.0}
UNKNOWN_LOAD = {
    "loads.tip.known": False,
    "loads.tip.process_noise": {"model": "oscillator"},
    "parameters.E.guess": 2.1e11,
    "place.estimate": ["tip"],
    "validate.initial_std": {"tip": 0.5},
}
ROSETTES = {
    "gauges.direction": {"type": "axis", "axis": [1, 0, 0], "angles": [0.0, 60.0]},
    "gauges.rosette": True,
    "tolerances": NOTHING | ZEROS,
}


def test_the_filter_allows_for_drifts_of_channels_and_one_temperature_that_each_rosette_reads_its_way(beam):
    """The covariance of readings of two rosettes at the end of the record."""
    own = beam(ROSETTES)
    channels = own.problem.channels.of(own.gauges[:2]).ravel()
    model = filter_model(own.problem, channels, own.problem.h)
    considered = build_considered(own.tolerated, model, channels)
    assert considered.source == ("drift",) * 4 + ("temperature",) * 3
    for nothing in (considered.D, considered.offset, considered.E[..., :-1]):
        assert not nothing.any()
    late = considered.E[..., -1]
    common, beside, each = (8.0 * 1e-6) ** 2, (8.0 * 5e-7) ** 2, (4e-6) ** 2
    expected = common + np.kron(np.eye(2), beside * np.ones((2, 2))) + each * np.eye(4)
    np.testing.assert_allclose(late.T @ late, expected, rtol=1e-12)


def test_a_truth_drifts_as_drawn(beam):
    own, exact = (beam({"tolerances": stated}) for stated in (NOTHING | ZEROS, "none"))
    found, plain = trial(own), trial(exact)
    time = np.linspace(0, 1, len(found.time))
    for realisation in (1, 2):
        drawn = installation_of(own.case.config, own.training.candidates, realisation).drift[own.channels]
        added = found.again(realisation) - plain.reading(plain.chosen)
        np.testing.assert_allclose(added, np.outer(time, drawn), atol=1e-9 * np.abs(drawn).max())


DRAWN = {
    "loads, modulus": (OF_E, ALL | {"discrepancy": 0.02}),
    "loads, load": (OF_A_LOAD, ALL | {"discrepancy": 0.02}),
    "drifts, modulus": ({}, LARGE),
    "drifts, load": (UNKNOWN_LOAD, LARGE),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", DRAWN)
def test_drawn_errors_leave_the_truth_within_sigma(beam, case):
    """200 truths; of loads with the default discrepancy, for their second order; drifts far above the process noise of
    a load. Without the tolerances σ is too small."""
    changes, tolerances = DRAWN[case]
    own = beam(changes | {"tolerances": NOTHING | tolerances})
    inside, ratio, _ = spread(own, 200)
    assert 0.92 < inside < 0.98
    assert 0.85 < ratio < 1.15
    assert spread(own, 40, beam(changes | {"tolerances": NOTHING}).tolerated)[1] > 1.5


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "tolerances"), [(OF_A_LOAD, SMALL), (UNKNOWN_LOAD, LARGE)], ids=["loads", "drifts"])
def test_what_is_learned_of_errors_leaves_an_unknown_load_within_sigma(beam, changes, tolerances):
    """σ is smaller than where they are not learned. Of turns of several degrees it holds to first order."""
    own, considered = (beam(changes | {"tolerances": NOTHING | tolerances | {"treat": how}}) for how in ("estimate", "consider"))
    inside, ratio, level = spread(own, 200)
    assert inside > 0.92
    assert ratio < 1.15
    assert level < spread(considered, 10)[2]


TURN = 30.0


def test_a_gauge_taken_as_turned_has_the_mean_of_one_that_is(tmp_path):
    few = f"gauges.direction.angles=[0, {TURN}]", "tolerances={angle: 6.0}", "gauges.clearance=none"
    own = prepared(tmp_path, bricks((10, 2, 2), "hex20"), {"screen": {"keep": "all"}}, *few)
    structure, training = own.structure, own.training
    problem, pool = problem_of(own.structure, own.screened), training.candidates
    one = int(np.flatnonzero((pool.angle == 0) & (pool.normal[:, 2] > 0.99) & (np.abs(pool.position[:, 0] - 0.25) < 0.05))[0])
    (twin,) = np.flatnonzero((pool.angle == TURN) & (pool.element == pool.element[one]) & (pool.facet == pool.facet[one]))

    def averaged(channel):
        channels = np.array([channel])
        own = tolerated(structure, channels)
        plain = filter_model(problem, channels, 0.001)
        return own, plain, on_average(own, plain, channels)

    own, _, model = averaged(one)
    test = SimpleNamespace(channels=np.array([one]), known=np.zeros((1, 3, 0)), values=None)
    start = np.zeros((model.size, model.size))
    given = SimpleNamespace(model=model, test=test, problem=problem, covariance=start, tolerances=own, biased=None, settled=None)
    turning = turning_of(structure, test.channels)
    found, _ = build_check_record(structure, given, turning).turned(0, TURN)
    assert not start.any()  # the start at rest of the filter is left as it is
    _, plain, wanted = averaged(int(twin))
    size = np.abs(wanted.H).max()
    np.testing.assert_allclose(found.H, wanted.H, atol=1e-9 * size)
    assert np.abs(wanted.H - plain.H).max() > 5e-3 * size  # what would be missing
