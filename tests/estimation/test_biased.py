"""Offsets of channels as states: the model of [x, b] against the plain model, differences, and a record with an offset."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.estimation.biased import Biased
from strainsight.estimation.draws import draw_truth
from strainsight.estimation.filter import filter_runs
from strainsight.estimation.motion import measure
from strainsight.estimation.reduced import Driven

AT = np.array([0, 2])
STEPS = 150


@pytest.fixture(scope="module")
def filters(make_beam, make_filter):
    """The linear filter model of a tip force, and one of the modulus too, under a known force in the middle."""
    beam = make_beam(modes=3, load_nodes=(16, 8))
    known = np.tile(np.array([50.0, 20.0, -10.0])[:, None], (STEPS, 1, 1))
    return {
        unknown: Driven(
            make_filter(beam, ("tip",), unknown, ("middle",), accelerometers=1, h=1e-3, noise_step=1e-3), known
        )
        for unknown in ((), ("E",))
    }


@pytest.mark.parametrize("unknown", [(), ("E",)])
def test_an_offset_adds_itself_to_its_channel_and_nothing_else(filters, unknown):
    """Linear in b, so differences are exact; the rest is the plain model's."""
    plain = filters[unknown]
    model, n = Biased(plain, AT), plain.size
    rng = np.random.default_rng(4)
    x = rng.normal(size=(2, n)) * np.where(np.arange(n) < 6, 1e-4, 0.01)
    b = rng.normal(size=(2, len(AT)))
    both = np.hstack([x, b])
    for function, own, kept in ((model.step, plain.step, n), (model.measure, plain.measure, model.channels)):
        value, slope = function(both, 3)
        there, base = own(x, 3)
        shift = np.zeros_like(value[:, :kept])
        if function == model.measure:
            shift[:, AT] = b
        np.testing.assert_array_equal(value[:, :kept], there + shift)
        np.testing.assert_array_equal(slope[..., :kept, :n], base)
        moved = function(np.hstack([x, b + 1.0]), 3)[0] - value
        np.testing.assert_allclose(moved, np.broadcast_to(slope[..., n:].sum(axis=-1), moved.shape), atol=1e-12)
    np.testing.assert_array_equal(model.step(both, 3)[0][:, n:], b)


@pytest.mark.parametrize("unknown", [(), ("E",)])
def test_a_known_offset_is_one_taken_from_the_record(filters, unknown):
    """b known without doubt: the filter on y is the plain filter on y − E b."""
    plain = filters[unknown]
    model, b = Biased(plain, AT), np.array([3e-5, -2e-5])
    mean = np.zeros(plain.size)
    P = np.diag([0.0] * 6 + [1e-2] + [1e-6] * len(unknown))
    _, y = draw_truth(plain.model, mean, P, plain.known, [0])
    read = y.copy()
    read[..., AT] += b
    expected = filter_runs(plain, mean, P, y, keep="all")
    corner = np.zeros((model.size, model.size))
    corner[: plain.size, : plain.size] = P
    found = filter_runs(model, np.append(mean, b), corner, read, keep="all")
    scale = np.abs(expected.mean).max(axis=(0, 1))
    assert np.all(np.abs(found.mean[..., : plain.size] - expected.mean) <= 1e-9 * scale)
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=1e-9)
    assert np.all(found.mean[..., plain.size :] == b)


def test_an_offset_is_found_and_stays_what_it_is(filters):
    plain = filters[()]
    model, b = Biased(plain, AT), np.array([3e-5, -2e-5])
    mean, P = np.zeros(plain.size), np.diag([0.0] * 6 + [1e-2])
    _, y = draw_truth(plain.model, mean, P, plain.known, [0])
    y[..., AT] += b
    start = np.diag(np.append(np.diag(P), [1e-8, 1e-8]))
    run = filter_runs(model, np.zeros(model.size), start, y, keep="all")
    last, std = run.mean[-1, 0, -2:], np.sqrt(np.diagonal(run.covariance[-1, 0]))[-2:]
    assert np.all(np.abs(last - b) < 4 * std)
    assert np.all(std < 0.1 * np.abs(b))
    # no process noise acts on it: what is known of it is never lost again
    known = np.diagonal(run.covariance[:, 0], axis1=-2, axis2=-1)[:, -2:]
    assert np.all(np.diff(known, axis=0) <= 1e-12 * known[:-1])


def test_a_known_force_reaches_the_accelerometers_as_the_general_measurement_says(filters):
    """The linear filter adds it as a term a step; the measurement that also parameters use takes it at the step's end."""
    plain = filters[()]
    x = np.random.default_rng(2).normal(size=(2, plain.size)) * 1e-4
    expected = measure(plain.model, x, plain.known[3].sum(axis=-2))[0]
    np.testing.assert_allclose(plain.measure(x, 3)[0], expected, rtol=1e-12)
    assert np.any(
        np.abs(expected - measure(plain.model, x, 0 * plain.known[3].sum(axis=-2))[0]) > 1e-3 * np.abs(expected)
    )
