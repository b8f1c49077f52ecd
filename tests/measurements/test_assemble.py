"""A test as it comes from the rig, and its bridges, back to the truth."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements.assemble import assemble, find_repeated_samples, remove_repeated_samples
from strainsight.measurements.calibration import ARRANGEMENTS, Bridge, ChannelSettings, strain_of
from strainsight.measurements.clock import Delay
from strainsight.measurements.records import Recording

from ..refusals import expect_refusal

COUNT, STEP = 2000, 1e-3
TIME = 5.0 + STEP * np.arange(COUNT)
RNG = np.random.default_rng(7)
UNLOADED = TIME < 5.2
STRAIN = np.where(UNLOADED, 0.0, 8e-4 * np.sin(40 * (TIME - 5.2)))
ACCELERATION = np.where(UNLOADED, 0.0, 30.0 * np.cos(90 * TIME))
FORCE = np.where(UNLOADED, 0.0, 2500.0 * np.sin(3 * (TIME - 5.2)))
LOST = {name: RNG.random(COUNT) < 0.1 for name in ("g1", "g2", "acc")}
GAP = np.r_[700:712, 1500]
KEPT = np.setdiff1d(np.arange(COUNT), GAP)
SETTINGS = {
    "g2": ChannelSettings("mV/V", bridge=Bridge("half-poisson", 2.05, 0.3), zero=(5.0, 5.199), sign=-1),
    "F": ChannelSettings("kN"),
    "g1": ChannelSettings("um/m", drift=4.0, zero=(5.0, 5.199)),
    "acc": ChannelSettings("g", offset=0.25),
}
TRUTH = {"g1": STRAIN, "g2": STRAIN, "acc": ACCELERATION, "F": FORCE}
UNITS = {"g1": "µm/m", "g2": "mV/V", "acc": "g", "F": "kN"}


def readings():
    """What the rig writes: names → (COUNT,), NaN where a sample is lost."""
    x = 2.05 * STRAIN
    found = {
        "g1": 1e6 * STRAIN + 12.0 + 4.0 * (TIME - TIME[0]),
        # One gauge along, one across, adjacent; wired the other way round and out of balance.
        "g2": 0.3 - 1e3 * ((1 + x) / (2 + 0.7 * x) - 0.5),
        "acc": ACCELERATION / 9.80665 + 0.25,
        "F": FORCE / 1e3,
    }
    for name, lost in LOST.items():
        found[name] = np.where(lost, np.nan, found[name])
    return found


def test_assembled_signals_match_truth():
    channels = {name: values[KEPT] for name, values in readings().items()}
    signals = assemble(Recording(TIME[KEPT], channels, UNITS, "rig.csv"), SETTINGS)
    assert signals.names == ("g2", "F", "g1", "acc")
    assert signals.quantities == ("strain", "force", "strain", "acceleration")
    np.testing.assert_allclose(signals.time, TIME, rtol=1e-9)
    for column, name in enumerate(signals.names):
        gone = np.isin(np.arange(COUNT), GAP) | LOST.get(name, np.zeros(COUNT, bool))
        np.testing.assert_array_equal(np.isnan(signals.values[:, column]), gone)
        scale = np.abs(TRUTH[name]).max()
        np.testing.assert_allclose(signals.values[~gone, column], TRUTH[name][~gone], rtol=0, atol=1e-12 * scale)
    assert any(note.startswith("rows without samples were inserted after 5.699 s (12 in total") for note in signals.notes)
    assert any(note.startswith("rows without samples were inserted after 6.499 s (1 in total") for note in signals.notes)
    assert f"g1: missing samples in the file: {int(LOST['g1'][KEPT].sum())} of {len(KEPT)}" in signals.notes
    assert "g2: converted from mV/V to strain with a half-poisson bridge and gauge factor 2.05" in signals.notes


@pytest.mark.parametrize("factor", [0.25, 0.5, 1, 2, 5])
def test_filter_step_does_not_shift_samples(factor):
    recording = Recording(TIME[KEPT], {"F": readings()["F"][KEPT]}, {"F": None}, "rig.csv")
    signals = assemble(recording, {"F": SETTINGS["F"]}, STEP * factor)
    assert np.diff(signals.time) == pytest.approx(STEP * factor, rel=1e-6)
    seen = np.flatnonzero(~np.isnan(signals.values[:, 0]))
    sample = np.rint((signals.time[seen] - TIME[0]) / STEP).astype(int)
    np.testing.assert_allclose(signals.time[seen], TIME[sample], rtol=0, atol=1e-9)
    np.testing.assert_allclose(signals.values[seen, 0], FORCE[sample], rtol=1e-14)
    expected = KEPT if factor < 1 else KEPT[KEPT % factor == 0]
    np.testing.assert_array_equal(sample, expected)


LATE = 7


def late_record(gap=()):
    row = np.setdiff1d(np.arange(100), gap)
    time = 2.0 + STEP * row
    channels = {"a": np.sin(30 * time), "b": np.sin(30 * (time - LATE * STEP))}
    return Recording(time, channels, {"a": "m/m", "b": "m/m"}, "rig.csv")


@pytest.mark.parametrize(
    "delay", [Delay(samples=LATE), Delay(seconds=LATE * STEP), Delay(seconds=LATE * STEP * 1.0005)]
)
def test_delayed_channel_is_shifted(delay):
    found = assemble(late_record(), {"a": ChannelSettings("m/m"), "b": ChannelSettings("m/m", delay=delay)})
    np.testing.assert_allclose(found.values[:-LATE, 1], found.values[:-LATE, 0], atol=1e-12)
    assert np.isnan(found.values[-LATE:, 1]).all()
    assert any("b: a delay of 7 samples was corrected" in note for note in found.notes)


@pytest.mark.parametrize("step", [2 * STEP, STEP / 2])
def test_delay_is_in_file_samples(step):
    settings = {"a": ChannelSettings("m/m"), "b": ChannelSettings("m/m", delay=Delay(samples=LATE))}
    found = assemble(late_record(gap=[40, 41]), settings, step)
    there = np.isfinite(found.values).all(axis=1)
    assert there.sum() > 35
    np.testing.assert_allclose(found.values[there, 1], found.values[there, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("delay", "what"),
    [
        (Delay(seconds=2.4 * STEP), r"a delay of 0\.0024 s is 2\.4 samples of 0\.001 s, but must be a whole number"),
        (Delay(samples=100), "the delay is 100 samples, but the record has only 100"),
        (Delay(seconds=-1.0), "the delay is -1000 samples, but the record has only 100"),
    ],
)
def test_invalid_delay_is_refused(delay, what):
    with expect_refusal(UserError, what, key="b"):
        assemble(late_record(), {"b": ChannelSettings("m/m", delay=delay)})


# Channels whose last value is repeated, and those that only look so.
SAMPLES = 400
INDEX = np.arange(SAMPLES)
MOVING = 50 * np.sin(0.05 * INDEX) + np.random.default_rng(1).standard_normal(SAMPLES)


def held(n, values=MOVING, phase=0):
    return values[np.maximum((INDEX - phase) // n * n + phase, 0)]


@pytest.mark.parametrize("n", [2, 5, 20])
@pytest.mark.parametrize("phase", [0, 1])
def test_first_repeated_sample_is_kept(n, phase):
    found, notes = remove_repeated_samples("F", held(n, phase=phase), 1e-3)
    fresh = np.flatnonzero(np.isfinite(found))
    np.testing.assert_array_equal(np.diff(fresh), n)
    assert fresh[0] == phase
    np.testing.assert_array_equal(found[fresh], MOVING[fresh])
    assert f"every sample {n} times, so the channel was sampled at {1000 / n:.4g} Hz" in notes[0]
    assert f"a mean delay of {(n - 1) / 2:g} samples" in notes[0]


def test_repetition_is_found_despite_rest_and_gaps():
    values = held(4, np.where(INDEX < 100, 0.0, MOVING))
    values[[0, 250]] = np.nan
    found, _ = remove_repeated_samples("F", values, 1e-3)
    assert np.isfinite(found).sum() == SAMPLES // 4 - 1


@pytest.mark.parametrize(
    "values",
    [
        MOVING,
        np.zeros(SAMPLES),
        np.round(INDEX / 5.0),  # a slow ramp in steps of the resolution
        np.round(5 * np.sin(0.02 * INDEX)),
        np.where(INDEX % 2 == 0, MOVING, np.nan),
        np.repeat(np.arange(4.0) ** 2, 100),  # four dead weights
        np.clip(MOVING, -20, 20),
    ],
)
def test_equal_samples_without_pattern_are_kept(values):
    assert find_repeated_samples(values) is None
    found, notes = remove_repeated_samples("F", values, 1e-3)
    assert found is values
    assert notes == ()


def test_noninteger_rate_ratio_is_refused():
    values = MOVING[np.floor(np.floor(INDEX / 3.4) * 3.4).astype(int)]
    with pytest.raises(UserError, match=r"'F' contains every sample 3 or 4 times: it was sampled at 250 to 333\.3 Hz and"):
        remove_repeated_samples("F", values, 1e-3)


# The inverse of an exact Wheatstone bridge, solved by Kirchhoff's laws.
NU = 0.29
GAUGES = {
    # Where the resistors R1 to R4 sit: "+" along in tension, "-" along in compression, "t" across a "+", "c" across a "-", "q"
    # and "p" where a quarter of the sum is, in tension and in compression.
    "quarter": "+   ",
    "half": "+-  ",
    "half-opposite": "+ + ",
    "half-poisson": "+t  ",
    "full": "+-+-",
    "full-bending-poisson": "+-ct",
    "full-poisson": "+t+t",
    "sum": "qpqp",
}


def output(places: str, gauge_factor: float, strain: float) -> float:
    """Output over excitation: the two node voltages of four resistors under 1 V.

    R1 from the supply to node A, R2 from A to ground, R4 from the supply to node B, R3 from B to ground.
    """
    local = {"+": strain, "-": -strain, "t": -NU * strain, "c": NU * strain, " ": 0.0}
    local |= {"q": strain / 4, "p": -strain / 4}
    return wheatstone(gauge_factor * np.array([local[place] for place in places]))


def wheatstone(x: np.ndarray) -> float:
    R1, R2, R3, R4 = 350.0 * (1 + x)
    conductance = np.diag([1 / R1 + 1 / R2, 1 / R3 + 1 / R4])
    node = np.linalg.solve(conductance, [1 / R1, 1 / R4])
    return node[1] - node[0]


@pytest.mark.parametrize("arrangement", ARRANGEMENTS)
@pytest.mark.parametrize("strain", [1e-6, 1e-3, 0.05, -1e-6, -1e-3, -0.05])
def test_bridge_formula_is_exact_inverse(arrangement, strain):
    bridge = Bridge(arrangement, 2.07, NU if "poisson" in arrangement else None)
    r = output(GAUGES[arrangement], 2.07, strain)
    # A difference of two voltages near 0.5 V carries 1e-16 V.
    assert strain_of(bridge, np.array([r]))[0] == pytest.approx(strain, rel=1e-12, abs=1e-15)
    assert r * strain > 0


@pytest.mark.parametrize(
    ("arms", "low"),
    [
        ((900e-6, -900e-6, 400e-6, -400e-6), 0.0),  # neighbours that add up to zero
        ((1000e-6, 0.0, 1000e-6, 0.0), 1e-3),  # axial, two completed by resistors: as low as a quarter bridge
        ((1500e-6, -500e-6, 700e-6, -300e-6), (2000 * 1000 + 1000 * 400) / 3000 * 1e-6),
    ],
)
def test_bridge_sum_is_linear_with_known_error(arms, low):
    """GF 2: every leg is read (ε₁ + ε₂) of its share too low, to first order; the second order is 1e-6 of it here."""
    arms = np.array(arms)
    total = arms @ [1, -1, 1, -1]
    r = wheatstone(2.0 * arms)
    read = strain_of(Bridge("sum", 2.0), np.array([r]))[0]
    assert read == pytest.approx(4 * r / 2.0, rel=1e-14)
    assert 1 - read / total == pytest.approx(low, rel=2e-3, abs=1e-12)


def test_impossible_bridge_output_is_nan():
    r = np.array([np.nan, 0.0, 0.49, 0.5, 0.7, -0.49, -0.5, 9.0])
    np.testing.assert_array_equal(np.isnan(strain_of(Bridge("quarter", 2.0), r)), [1, 0, 0, 1, 1, 0, 1, 1])
    np.testing.assert_array_equal(
        np.isnan(strain_of(Bridge("full", 2.0), np.array([0.99, 1.01, -0.99, -1.01]))), [0, 1, 0, 1]
    )
