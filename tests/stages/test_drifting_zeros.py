"""Zeros that drift, and a part that warms up: drawn truths within σ, and what the filter allows for is what is drawn."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.cases.structure.drawn import in_words, installation_of, varies
from strainsight.cases.structure.nuisances import nuisances_of
from strainsight.cases.structure.problem import filter_model

from .drawn_truths import NOTHING, beam_in, spread, trial

ZEROS = {"drift": 4e-6, "temperature": 8.0, "thermal_output": 1e-6, "thermal_spread": 5e-7}
LARGE = ZEROS | {"drift": 1.2e-5, "temperature": 24.0}
UNKNOWN_LOAD = {
    "loads.tip.known": False,
    "loads.tip.process_noise": {"model": "oscillator"},
    "parameters.E.guess": 2.1e11,
    "place.estimate": ["tip"],
    "validate.initial_std": {"tip": 0.5},
}


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    return beam_in(tmp_path_factory.mktemp("beam"))


ROSETTES = {
    "gauges.direction": {"type": "axis", "axis": [1, 0, 0], "angles": [0.0, 60.0]},
    "gauges.rosette": True,
    "tolerances": NOTHING | ZEROS,
}


def test_what_the_filter_allows_for_has_the_covariance_of_what_is_drawn(beam):
    """Of readings of two rosettes at the end of the record, over 3000 draws: one temperature, and what a rosette reads of it."""
    own = beam(ROSETTES)
    channels = own.problem.channels.of(own.gauges[:2]).ravel()
    model = filter_model(own.problem, channels, own.problem.h)
    nuisances = nuisances_of(own.tolerated, model, channels)
    assert nuisances.source == ("drift",) * 4 + ("temperature",) * 3
    for nothing in (nuisances.D, nuisances.offset, nuisances.E[..., :-1]):
        assert not nothing.any()
    late, pool = nuisances.E[..., -1], own.training.candidates
    drawn = np.array([installation_of(own.case.config, pool, i).drift[channels] for i in range(3000)])
    allowed, found = late.T @ late, drawn.T @ drawn / len(drawn)
    np.testing.assert_allclose(found, allowed, atol=0.1 * allowed.max())
    common, beside, each = (8.0 * 1e-6) ** 2, (8.0 * 5e-7) ** 2, (4e-6) ** 2
    one = np.array([[1.0, 1.0], [1.0, 1.0]])
    expected = common + np.kron(np.eye(2), beside * one) + each * np.eye(4)
    np.testing.assert_allclose(allowed, expected, rtol=1e-12)


def test_some_gauges_alone_drift_as_they_do_among_all(beam):
    own = beam({"tolerances": NOTHING | ZEROS})
    ends = []
    for channels in (own.channels, own.channels[[2, 0]]):
        late = nuisances_of(own.tolerated, filter_model(own.problem, channels, own.problem.h), channels).E[..., -1]
        ends.append(late.T @ late)
    np.testing.assert_allclose(ends[1], ends[0][np.ix_([2, 0], [2, 0])], rtol=1e-12)


def test_a_truth_drifts_as_drawn_and_says_so(beam):
    own, exact = (beam({"tolerances": stated}) for stated in (NOTHING | ZEROS, "none"))
    found, plain = trial(own), trial(exact)
    assert varies(own.case.config)
    assert not varies(beam({"tolerances": NOTHING | {"temperature": 8.0, "thermal_output": 0, "thermal_spread": 0}}).case.config)
    time = np.linspace(0, 1, len(found.time))
    for realisation in (1, 2):
        drawn = installation_of(own.case.config, own.training.candidates, realisation).drift[own.channels]
        added = found.again(realisation) - plain.reading(plain.chosen)
        np.testing.assert_allclose(added, np.outer(time, drawn), atol=1e-9 * np.abs(drawn).max())
    for text in ("drift 4 µm/m", "temperature 8 K"):
        assert text in in_words(own.case.config, given=True)


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, UNKNOWN_LOAD], ids=["modulus", "load"])
def test_drawn_drifts_leave_the_truth_within_sigma(beam, changes):
    """200 truths with drifts and a temperature of their own, far above the process noise of a load; without the tolerances σ is
    too small."""
    own = beam(changes | {"tolerances": NOTHING | LARGE})
    inside, ratio, _ = spread(own, 200)
    assert 0.92 < inside < 0.98
    assert 0.85 < ratio < 1.15
    assert spread(own, 40, beam(changes | {"tolerances": NOTHING}).tolerated)[1] > 1.5


@pytest.mark.slow
def test_what_is_learned_of_drifts_leaves_an_unknown_load_within_sigma(beam):
    """σ is smaller than where they are not learned."""
    own, considered = (beam(UNKNOWN_LOAD | {"tolerances": NOTHING | LARGE | {"treat": how}}) for how in ("estimate", "consider"))
    inside, ratio, level = spread(own, 200)
    assert inside > 0.92
    assert ratio < 1.15
    assert level < spread(considered, 10)[2]
