"""Rainflow counting, damage sums and their intervals."""

from __future__ import annotations

from collections import Counter
from math import gamma

import numpy as np
import pytest
import rainflow as other

from strainsight.damage import (
    FKM,
    GOODMAN,
    Curve,
    Interval,
    MeanStress,
    _correct,
    _count,
    _cycle_damage,
    damage_of,
    equivalent_range,
    interval_of,
    scalar_stress,
)

ONE_LINE = Curve(1e8, 2e6, 3.0)
TWO_LINES = Curve(71e6, 2e6, 3.0, 5e6, 5.0, 1e8)
"""EN 1993-1-9, detail category 71."""


def cosine(amplitude, cycles=50, samples=64, mean=0.0):
    return mean + amplitude * np.cos(2 * np.pi * np.arange(cycles * samples + 1) / samples)


@pytest.mark.parametrize("slope", [1.0, 3.0, 5.0, 8.5, 20.0])
@pytest.mark.parametrize("amplitude", [1e3, 4e7, 3e9])
def test_constant_amplitude_is_the_closed_form(slope, amplitude):
    """n (2A/Δσ)^m / N, and an equivalent range of 2A (n/N_eq)^(1/m)."""
    curve = Curve(1e8, 2e6, slope)
    found = damage_of(cosine(amplitude)[None], curve)
    assert found.miner[0] == pytest.approx(50 * (2 * amplitude / 1e8) ** slope / 2e6, rel=1e-9)
    expected = 2 * amplitude * (50 / 1e6) ** (1 / slope)
    assert equivalent_range(found.moment, curve, 1e6)[0] == pytest.approx(expected, rel=1e-9)


def test_second_slope_and_cut_off_are_those_of_the_standard():
    """EN 1993-1-9, table 7.1: Δσ_D = (2/5)^(1/3) Δσ_C = 0.737 Δσ_C, Δσ_L = (5/100)^(1/5) Δσ_D = 0.549 Δσ_D."""
    knee, cut_off = TWO_LINES.knee_range, TWO_LINES.cut_off_range
    assert knee / 71e6 == pytest.approx(0.737, abs=5e-4)
    assert cut_off / knee == pytest.approx(0.549, abs=5e-4)
    ranges = np.array([0.99 * cut_off, 1.01 * cut_off, 0.5 * (knee + cut_off), knee, 71e6, 1e9])
    N = 1 / np.array([_cycle_damage(each, TWO_LINES.numbers) for each in ranges[1:]])
    np.testing.assert_allclose(N[:2], 5e6 * (knee / ranges[1:3]) ** 5, rtol=1e-12)
    np.testing.assert_allclose(N[2:], [5e6, 2e6, 2e6 * (71e6 / 1e9) ** 3], rtol=1e-9)
    assert _cycle_damage(ranges[0], TWO_LINES.numbers) == 0


def test_no_second_slope_is_no_damage_below_the_knee():
    endurance = Curve(1e8, 2e6, 3.0, 1e7)
    level = endurance.knee_range
    for factor, some in ((0.999, False), (1.001, True)):
        found = damage_of(cosine(factor * level / 2)[None], endurance)
        assert (found.miner[0] > 0) == some
        assert found.moment[0] > 0


@pytest.mark.parametrize("slope", [3.0, 5.0])
def test_a_narrow_band_is_rayleighs(slope):
    """Ranges of a narrow-band normal process: E[D] = n (2√2 s/Δσ)^m Γ(1 + m/2)/N."""
    rng = np.random.default_rng(7)
    cycles, samples, s = 40_000, 24, 2e7
    # amplitude that wanders over some fifty periods
    frequency = np.fft.rfftfreq(cycles * samples)
    shape = np.exp(-0.5 * ((frequency * samples - 1) / 0.01) ** 2)
    spectrum = shape * (rng.standard_normal(len(shape)) + 1j * rng.standard_normal(len(shape)))
    stress = np.fft.irfft(spectrum, cycles * samples)
    stress *= s / stress.std()
    expected = cycles * (2 * np.sqrt(2) * s / 1e8) ** slope * gamma(1 + slope / 2) / 2e6
    # some 40 000/50 independent amplitudes: σ of the sum is 3 to 6 %, and peaks between samples lose m (π/24)²/4
    assert damage_of(stress[None], Curve(1e8, 2e6, slope)).miner[0] == pytest.approx(expected, rel=0.12)


def test_miner_is_the_sum_over_the_cycles_of_another_implementation():
    rng = np.random.default_rng(8)
    stress = 5e7 * rng.standard_normal((3, 900))
    for own, found in zip(stress, damage_of(stress, TWO_LINES).miner, strict=True):
        expected = 0.0
        for size, _, count, _, _ in other.extract_cycles(own):
            knee, cut_off = 71e6 * 0.4 ** (1 / 3), 71e6 * 0.4 ** (1 / 3) * 0.05**0.2
            N = 2e6 * (71e6 / size) ** 3 if size >= knee else 5e6 * (knee / size) ** 5 if size > cut_off else np.inf
            expected += count / N
        assert found == pytest.approx(expected, rel=1e-12)


def test_goodman_is_the_closed_form():
    R = 4e8
    found = damage_of(cosine(5e7, mean=1e8)[None], ONE_LINE, MeanStress(GOODMAN, R)).miner[0]
    assert found == pytest.approx(50 * (1 / (1 - 1e8 / R)) ** 3 / 2e6, rel=1e-6)
    pressed = damage_of(cosine(5e7, mean=-1e8)[None], ONE_LINE, MeanStress(GOODMAN, R)).miner[0]
    assert pressed == pytest.approx(50 / 2e6, rel=1e-6)
    assert damage_of(cosine(5e7, mean=R)[None], ONE_LINE, MeanStress(GOODMAN, R)).miner[0] == np.inf


def test_fkm_at_its_corners():
    """R = ∞, −1, 0 and ½, where its lines meet: 1 − M, 1, 1 + M and (1 + M)²/(1 + M/3) times the amplitude."""
    M, a = 0.3, 5e7
    means = a * np.array([-5.0, -1.0, 0.0, 1.0, 3.0, 9.0])
    last = (1 + M) ** 2 / (1 + M / 3)
    expected = 2 * a * np.array([1 - M, 1 - M, 1.0, 1 + M, last, last])
    np.testing.assert_allclose([_correct(2 * a, mean, FKM, M) for mean in means], expected, rtol=1e-12)
    for mean in means[1:5]:
        near = [_correct(2 * a, mean + step, FKM, M) for step in (-1.0, 1.0)]
        assert abs(near[1] - near[0]) < 4


def test_one_number_of_a_state_is_that_of_its_tensor():
    """Against eigenvalues, and von Mises' from their differences."""
    rng = np.random.default_rng(11)
    stress = 1e8 * rng.standard_normal((40, 6, 25))
    flat = np.moveaxis(stress, 1, 2)
    tensor = np.zeros((40, 25, 3, 3))
    for place, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)]):
        tensor[..., i, j] = tensor[..., j, i] = flat[..., place]
    value = np.linalg.eigvalsh(tensor)
    largest = np.where(value[..., 2] + value[..., 0] > 0, value[..., 2], value[..., 0])
    mises = np.sqrt(0.5 * ((np.diff(value, axis=-1) ** 2).sum(axis=-1) + (value[..., 2] - value[..., 0]) ** 2))
    np.testing.assert_allclose(scalar_stress(stress, "principal"), largest, rtol=1e-7)
    np.testing.assert_allclose(scalar_stress(stress, "signed_von_mises"), np.sign(largest) * mises, rtol=1e-9)


def test_histories_with_nan_have_no_damage_and_do_not_touch_others():
    stress = np.stack([cosine(5e7), cosine(5e7)])
    stress[0, 7] = np.nan
    found = damage_of(stress, ONE_LINE)
    assert np.isnan(found.miner[0])
    assert np.isnan(found.moment[0])
    assert found.miner[1] == pytest.approx(50 / 2e6)


@pytest.mark.parametrize("count", [40, 100])
def test_it_holds_one_more_draw_in_95_of_100(count):
    rng = np.random.default_rng(12)
    draws = np.exp(2 * rng.standard_normal((count + 1, 20_000)))
    found, truth = interval_of(draws[:-1]), draws[-1]
    inside = np.mean((found.low <= truth) & (truth <= found.high))
    assert inside == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / 20_000))


def test_places_are_those_of_numpys_weibull_rule():
    draws = np.random.default_rng(13).standard_normal((97, 5))
    found = interval_of(draws)
    for own, q in ((found.median, 0.5), (found.low, 0.025), (found.high, 0.975)):
        np.testing.assert_allclose(own, np.quantile(draws, q, axis=0, method="weibull"), rtol=1e-12)


def test_infinite_draws_are_the_largest():
    draws = np.arange(100.0)[:, None] * np.ones(3)
    draws[99:, 0], draws[50:, 1], draws[:, 2] = np.inf, np.inf, np.inf
    found = interval_of(draws)
    assert found.high.tolist() == [pytest.approx(97.475), np.inf, np.inf]
    assert np.isfinite(found.median[0])
    assert np.isfinite(found.low[1])
    assert found.low[2] == np.inf


def test_too_few_draws_and_nan_are_refused():
    with pytest.raises(ValueError, match=r"39 random samples .* 40 are needed"):
        interval_of(np.zeros((39, 2)))


def test_widened_interval_has_its_median_and_a_multiple_of_its_width_in_logarithms():
    ends = [2.0, 0.0, np.inf, np.nan], [1.0, 0.0, 3.0, np.nan], [8.0, 1.0, np.inf, np.nan]
    found = Interval(*map(np.array, ends))
    wider = found.widened(2.0)
    np.testing.assert_array_equal(wider.median, found.median)
    np.testing.assert_allclose(wider.low, [0.5, 0.0, 3.0, np.nan])
    np.testing.assert_allclose(wider.high, [32.0, 1.0, np.inf, np.nan])
    assert found.widened(1.0) is found


def rainflow(signal):
    cycles = np.empty((len(signal), 3))
    return cycles[: _count(signal, np.empty((2, len(signal))), cycles)]


def by_range(cycles):
    counts = Counter()
    for size, _, count in cycles:
        counts[size] += count
    return dict(sorted(counts.items()))


def in_order(cycles):
    cycles = np.asarray(cycles, dtype=float)
    return cycles[np.lexsort(cycles.T)]


def test_the_example_of_the_standard():
    """ASTM E1049-85, figure 6 (X1): −2 1 −3 5 −1 3 −4 4 −2."""
    cycles = rainflow(np.array([-2.0, 1, -3, 5, -1, 3, -4, 4, -2]))
    assert by_range(cycles) == {3: 0.5, 4: 1.5, 6: 0.5, 8: 1.0, 9: 0.5}
    assert cycles.tolist()[2] == [4.0, 1.0, 1.0]


@pytest.mark.parametrize("levels", [None, 3, 12])
def test_counts_are_those_of_another_implementation(levels):
    rng = np.random.default_rng(3)
    for steps in (5, 40, 2000):
        signal = rng.standard_normal(steps)
        if levels is not None:
            signal = np.round(signal * levels / 4)
        theirs = [(size, mean, count) for size, mean, count, _, _ in other.extract_cycles(signal)]
        np.testing.assert_allclose(in_order(rainflow(signal)), in_order(theirs), rtol=0, atol=1e-12)


def test_constant_and_monotone_signals():
    assert len(rainflow(np.full(9, 3.0))) == 0
    assert len(rainflow(np.zeros(1))) == 0
    assert rainflow(np.linspace(0, 5, 50)).tolist() == [[5.0, 2.5, 0.5]]
