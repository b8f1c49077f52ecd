"""What misaligned loads strain where no gauge is, beyond the coordinates: against the full model, and drawn truths within σ."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.estimation.conditional import linear_models
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.grid_filter_smoother import smooth_on_grid
from strainsight.estimation.record import GridRecord
from strainsight.experiment.structure.considered import build_considered
from strainsight.experiment.structure.problem import filter_model, sample_std
from strainsight.experiment.structure.references import parameters_of
from strainsight.experiment.structure.start import loading_of
from strainsight.experiment.structure.tolerated_loads import field_beyond
from strainsight.experiment.structure.trial import sample_noise
from strainsight.experiment.structure.truth import truth_of
from strainsight.fem.loads import axes_across
from strainsight.mesh.facets import exterior_facets
from strainsight.sensors.strain_operator import channel_rows

from .drawn_truths import NOTHING, beam_in, trial
from .test_load_tolerances import OF_A_LOAD, SIDE, strain_under

TURNED = {"load_angle": 2.0, "load_position": 0.004}


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    return beam_in(tmp_path_factory.mktemp("beam"))


def free(own):
    """Every seventh channel of the pool that is none of the four gauges'."""
    return np.setdiff1d(np.arange(1, len(own.training.candidates), 7), own.channels)


def beside(own, field):
    """Strain at places without a gauge of a displacement field (3 nodes, r)."""
    part = own.training.candidates.take(free(own))
    return channel_rows(own.mesh.position, part, field, facets=exterior_facets(own.mesh))


def test_strain_where_no_gauge_is_follows_a_turned_and_a_shifted_load(beam):
    """Coordinates and what is beyond them, under a constant load with one of every ν, against central differences of turned and
    shifted forces on the full model: 1e-6 of the change, of which the coordinates alone miss more than a hundredth."""
    own = beam(OF_A_LOAD | {"loads.side": SIDE | {"process_noise": {"model": "random_walk"}}})
    own.parameters = parameters_of(own.case.config.parameters, own.mesh, {})
    model = filter_model(own.problem, own.channels, own.problem.h)
    considered = build_considered(own.tolerated, model, own.channels, behind=True)
    np.testing.assert_array_equal(considered.load, [0] * 4 + [1] * 5)
    linear = linear_models(model, np.zeros((1, 0)), considered)
    field = field_beyond(own.tolerated.loads, model, own.reduced)
    rows, n, w, h = beside(own, np.hstack([own.reduced.basis, field])), model.model.size, 700.0, 1e-4
    moving = slice(0, 2 * n)
    direction = np.array(own.case.config.loads["side"].direction)
    direction /= np.linalg.norm(direction)
    elsewhere = at_channels(own, free(own))
    missed = []
    x = np.zeros(linear.A.shape[1])
    x[model.position[0]] = w / model.amplitude[0]
    away = np.eye(moving.stop) - linear.A[0][moving, moving]
    x[moving] = np.linalg.solve(away, (linear.A[0] @ x)[moving])
    for k, axis in enumerate((*axes_across(direction), *axes_across(direction))):
        change = np.linalg.solve(away, (linear.A_nu[0, k] @ x)[moving])
        held = rows[:, :n] @ change[:n]
        if k < 2:
            ends = [Rotation.from_rotvec(sign * h * axis).apply(direction) for sign in (1, -1)]
            force, moment = (ends[0] - ends[1]) / (2 * h), np.zeros(3)
        else:
            force, moment = np.zeros(3), np.cross(axis, direction)
        slope = strain_under(elsewhere, own.reduced.model.reference, force, moment)
        expected = (np.deg2rad(2.0) if k < 2 else 0.004) * w * slope
        np.testing.assert_allclose(held + w * rows[:, n + k], expected, atol=1e-6 * np.abs(expected).max())
        missed.append(np.abs(held - expected).max() / np.abs(expected).max())
    assert max(missed) > 0.01
    # only a gain is of no shape
    assert not field[:, 8].any()


def at_channels(own, channels):
    """The beam, read at other channels."""
    other = type(own)(**vars(own))
    other.channels = channels
    return other


@pytest.mark.slow
@pytest.mark.parametrize("treat", ["consider", "estimate"])
def test_strain_where_no_gauge_is_lies_within_sigma_of_drawn_loads(beam, treat):
    """100 truths with direction and point of their own; σ without what is beyond the coordinates is too small at some places."""
    own = beam(OF_A_LOAD | {"tolerances": NOTHING | TURNED | {"treat": treat}})
    found = trial(own)
    model = filter_model(own.problem, found.chosen, found.h)
    field = field_beyond(own.tolerated.loads, model, own.reduced)
    rows, size = beside(own, np.hstack([own.reduced.basis, field])), model.size
    n, f = own.reduced.basis.shape[1], field.shape[1]
    whole = np.zeros((len(rows), size + f))
    whole[:, :n], whole[:, size:] = rows[:, :n], rows[:, n:]
    truth = truth_of(own.structure, None, own.problem, own.case)
    loading = loading_of(own.problem.run.settle, list(own.problem.run.signals.values()), found.h, len(found.known))
    errors, sigmas, without = [], [], []
    for realisation in range(1, 101):
        reading = found.again(realisation)
        noise = sample_noise(7, realisation, len(reading) - 1, reading.shape[1])
        y = reading[1:] + noise * sample_std(own.problem, found.chosen, found.h)
        considered = build_considered(own.tolerated, model, found.chosen, behind=True)
        args = (model, np.zeros(size), found.covariance, found.known, y)
        grid_run = filter_on_grid(GridRecord(*args, considered, settled=found.settled))
        later = smooth_on_grid(GridRecord(*args, considered, settled=found.settled), grid_run)
        there = truth.again(realisation, own.gauges)
        motion = there.motion(loading)
        errors.append(later.mean[:, 0] @ whole.T - motion.q @ beside(own, there.field()).T)
        sigmas.append(later.std_of(whole))
        without.append(later.std_of(np.pad(rows[:, :n], [(0, 0), (0, size + f - n)])))
    late = slice(len(errors[0]) // 4, None)
    error, std, bare = (np.array(values)[:, late] for values in (errors, sigmas, without))
    ratio = np.sqrt(np.mean(error**2, axis=(0, 1)) / np.mean(std**2, axis=(0, 1)))
    plain = np.sqrt(np.mean(error**2, axis=(0, 1)) / np.mean(bare**2, axis=(0, 1)))
    inside = np.mean(np.abs(error) < 2 * std)
    assert 0.92 < inside < 0.98
    assert ratio.min() > 0.85
    assert ratio.max() < 1.15
    assert plain.max() > 1.5
