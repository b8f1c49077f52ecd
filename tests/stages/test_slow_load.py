"""Advice on slower loads: near a resonance, where they reduce σ; not for slow, unknown or ineffective loads."""

from __future__ import annotations

import re

import numpy as np
import pytest

from strainsight import api

from ..edges.beam import bricks, placed, prepared

pytestmark = pytest.mark.usefixtures("no_hot_spots")


def sine(frequency):
    return {"type": "sine", "frequency": frequency, "amplitude": 100.0}


def band(frequency):
    return {"type": "multisine", "lowest": 0.97 * frequency, "highest": 1.03 * frequency, "count": 7, "amplitude": 100.0}


NEAR = 0.9
"""Frequency of a load near the resonance, over the first natural frequency."""


def changes(signal, step):
    """Load of 600 steps [s], noise of a good amplifier, and a jig."""
    timing = {"train.duration": 600 * step, "train.time_step": step}
    tolerances = {"position": 2e-4, "load_angle": 0.2, "frequency": 0.02, "load_mass": 0}
    return {
        "loads.tip.signal": signal, **timing, "screen.keep": 6, "gauges.noise_std": {"value": 1e-7}, "tolerances": tolerances
    }  # fmt: skip


def case(folder, signal, step, *overrides):
    """Small beam with this load; step [s]."""
    return prepared(folder, bricks((4, 1, 1)), changes(signal, step), *overrides)


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """First natural frequency [Hz]."""
    return float(prepared(tmp_path_factory.mktemp("beam"), bricks((4, 1, 1))).reduced.frequency[0])


def advised(own):
    return [words for words in placed(own).advice if "slow load" in words]


def test_a_slower_load_is_advised_near_the_resonance_with_the_sigma_that_it_would_have(first, tmp_path):
    """σ is 2r²σ_ω/(1 − r²) of the response over 1/(1 − r²) of the modulus, σ_ω common and half of it for the mode. Under the slow
    load gains of gauges and load remain."""
    own = case(tmp_path, sine(NEAR * first), 1 / (20 * first))
    (words,), found = advised(own), placed(own)
    shares = found.expected.budget["E"]
    assert f"tolerances.frequency ({100 * shares['frequency']:.0f} % of its variance). With" in words
    quoted, now = (float(x) for x in re.search(r"would be ([\d.]+) % instead of ([\d.]+) %", words).groups())
    assert now == pytest.approx(100 * 2 * NEAR**2 * 0.02 * np.sqrt(1.25), rel=0.05)
    assert quoted == pytest.approx(100 * np.sqrt(0.01**2 / 2 + 0.005**2 + 0.005**2), rel=0.15)
    (tmp_path / "slow").mkdir()
    slow = case(tmp_path / "slow", sine(first / 20), 1 / first)
    expected = api.expect(slow.case, slow.mesh, slow.reduced, slow.training, slow.screened, found.gauges)
    assert quoted == pytest.approx(100 * expected.std["E"], rel=0.05)


def test_no_slower_load_is_advised_for_a_band_over_the_resonance(first, tmp_path):
    """Several frequencies determine the natural frequency as well as the modulus."""
    own = case(tmp_path, band(first), 1 / (20 * first))
    assert placed(own).expected.budget["E"]["frequency"] < 0.5
    assert not advised(own)


@pytest.mark.parametrize(
    "overrides",
    [
        ("tolerances.frequency=0", "tolerances.damping=1"),
        ("loads.tip.known=false", "place.estimate=[E, tip]", "validate.initial_std={E: 0.1, tip: 1.0}"),
    ],
    ids=["exact", "unknown load"],
)
def test_no_slower_load_is_advised_where_frequencies_do_not_limit_sigma(first, tmp_path, overrides):
    assert not advised(case(tmp_path, sine(NEAR * first), 1 / (20 * first), *overrides))


def test_slow_load_is_not_advised_to_be_slower(first, tmp_path):
    own = case(tmp_path, sine(first / 20), 1 / first)
    assert not advised(own)
    assert np.isfinite(placed(own).expected.std["E"])


def test_density_is_not_advised_a_slower_load(first, tmp_path):
    """A static response does not depend on the mass."""
    density = {
        "parameters": {"rho": {"property": "density", "region": 1, "guess": 7850.0, "range": [6000.0, 9000.0]}},
        "place.estimate": ["rho"], "validate.initial_std": {"rho": 0.1}, "validate.truth.parameters": {},
    }  # fmt: skip
    own = prepared(tmp_path, bricks((4, 1, 1)), changes(sine(NEAR * first), 1 / (20 * first)) | density)
    assert sum(placed(own).expected.budget["rho"][key] for key in ("frequency", "damping")) > 0.5
    assert not advised(own)
