"""The evidence of faults against dense normal densities of the whole record, and what is named on a small model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation.conditional import none_considered
from strainsight.estimation.fault_evidence import BROAD, CheckRecord, explain_record, widen_tolerances
from strainsight.estimation.fault_search import examine_record, search_faults
from strainsight.estimation.faults import ANGLES, FORESEEN, Fault, shifted
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.peak import find_peak
from strainsight.estimation.record import GridRecord

from ..shared import slowly
from .chain import NOISE, STEPS, driven_chain, driven_start, forces, joint, loaded_chain, log_normal, start
from .truth import draw_truth

NO_OFFSETS = np.zeros(0, dtype=int)
FOUR = np.array([[1.0, 0.0], [-1.0, 1.0], [0.3, 1.0], [0.8, -0.5]])
TURNED = np.array([0.2, 0.9])
LONG = 300


def four_gauges(model):
    return replace(model, H=np.hstack([FOUR, np.zeros((4, 3))]), r=np.repeat(model.r[:1], 4))


def suspect(model, P, known, samples, turned_row=None):
    """With channel 0 turned, it reads another row."""
    m = samples.shape[1]
    rows = np.full((m, len(ANGLES), model.size), np.nan)

    def turned(channel, angle):
        H = model.H.copy()
        H[channel] = 0
        H[channel, :2] = turned_row
        changed = replace(model, H=H)
        return changed, none_considered(changed)

    if turned_row is not None:
        rows[0] = 0
        rows[0, :, :2] = turned_row
    mean = np.zeros(model.size)
    record = model, mean, P, known, samples, none_considered(model)
    return CheckRecord(*record, turned_rows=rows, turned=turned, load=np.arange(known.shape[-1]))


@pytest.fixture(scope="module")
def short():
    model, P = loaded_chain(), start()[:5, :5]
    _, y = draw_truth(model, np.zeros(5), P, forces(), [5])
    return model, P, y[:, 0]


def dense(y, P, extra=None):
    """ln of the density of the samples that are there (T, 2), in units of the noise; extra (T, 2): a column of unknown size."""
    mean, covariance = joint([0, 0], P)
    if extra is not None:
        covariance = covariance + np.outer(extra.ravel(), extra.ravel())
    there = np.isfinite(y.ravel())
    own = log_normal(y.ravel()[there], mean[there], covariance[np.ix_(there, there)])
    return own + there.sum() * np.log(NOISE)


def test_evidence_is_the_density_of_the_record_as_it_would_be_without_the_fault(short):
    model, P, y = short
    record = suspect(model, P, forces(), y)
    own = y.copy()
    assert explain_record(record, None)[0].evidence == pytest.approx(dense(own, P), abs=1e-6)
    own[:, 1] *= -1
    assert explain_record(record, Fault("sign", 1))[0].evidence == pytest.approx(dense(own, P), rel=1e-9)
    own = y / [1, 1e3]
    expected = dense(own, P) - STEPS * np.log(1e3)
    assert explain_record(record, Fault("scale", 1, 1e3))[0].evidence == pytest.approx(expected, rel=1e-9)
    assert explain_record(record, Fault("swapped", 0, 1))[0].evidence == pytest.approx(dense(y[:, ::-1], P), rel=1e-9)
    own = y.copy()
    own[:, 0] = shifted(y[:, 0], 3)
    expected = dense(own, P) + 3 * FORESEEN
    assert explain_record(record, Fault("late", 0, 3))[0].evidence == pytest.approx(expected, rel=1e-9)
    own[:, 0] = np.nan
    alone = explain_record(record, Fault("dead", 0))[0].evidence
    spread = y[:, 0].std()
    iid = -0.5 * STEPS - STEPS * np.log(np.sqrt(2 * np.pi) * spread / NOISE)
    assert alone == pytest.approx(dense(own, P) + iid, rel=1e-9)


def test_unlikely_fault_has_its_evidence_without_innovations(short):
    model, P, y = short
    record, fault = suspect(model, P, forces(), y), Fault("sign", 1)
    own = y * [1, -1]
    unlikely, run = explain_record(record, fault, least=explain_record(record, None)[0].evidence)
    assert run is None
    assert unlikely.ratio == np.inf
    assert unlikely.evidence == pytest.approx(dense(own, P), rel=1e-9)
    likely, exact = explain_record(record, fault, least=unlikely.evidence - 1)[0], explain_record(record, fault)[0]
    assert (likely.fault, likely.ratio, likely.point) == (exact.fault, exact.ratio, exact.point)
    assert likely.evidence == pytest.approx(exact.evidence, rel=1e-12)


@pytest.mark.parametrize("kind", ["offset", "drift"])
def test_an_offset_and_a_drift_are_those_of_generalised_least_squares(short, kind):
    """One column e of size N(0, u²): b̂ = u² eᵀC⁻¹r/(1 + u² eᵀC⁻¹e), by the dense covariance of the whole record."""
    model, P, y = short
    shape = np.zeros((STEPS, 2))
    shape[:, 1] = 1.0 if kind == "offset" else np.arange(1, STEPS + 1) / STEPS
    shifted_record = y + 0.05 * shape
    unit = BROAD * np.sqrt(np.mean(shifted_record[:, 1] ** 2))
    found, _ = explain_record(suspect(model, P, forces(), shifted_record), Fault(kind, 1))
    assert found.evidence == pytest.approx(dense(shifted_record, P, unit * shape), abs=1e-6)
    mean, covariance = joint([0, 0], P)
    e, r = shape.ravel(), shifted_record.ravel() - mean
    information = e @ np.linalg.solve(covariance, e) + unit**-2
    assert found.amount == pytest.approx(e @ np.linalg.solve(covariance, r) / information, rel=1e-6)
    assert found.std == pytest.approx(information**-0.5, rel=1e-6)


def test_turned_gauge_uses_rotated_row(short, monkeypatch):
    model, P, y = short
    monkeypatch.setattr("tests.estimation.chain.ROWS", np.array([TURNED, [-1.0, 1.0]]), raising=True)
    found, _ = explain_record(suspect(model, P, forces(), y, TURNED), Fault("angle", 0, 45.0))
    assert found.evidence == pytest.approx(dense(y, P), rel=1e-9)


def test_laplace_evidence_matches_grid_integral():
    model, P = driven_chain(), driven_start()
    steps = 200
    _, y = draw_truth(model, np.zeros(6), P, forces(steps), [5])
    none = none_considered(model)
    grid_run = filter_on_grid(GridRecord(model, np.zeros(6), P, forces(steps), y[:, 0], none_considered(model)))
    peak = find_peak(GridRecord(model, np.zeros(6), P, forces(steps), y[:, 0], none, NO_OFFSETS, None))
    assert peak.evidence == pytest.approx(float(grid_run.run.log_likelihood[0]), abs=0.1)
    mean, std = grid_run.run.mean[-1, 0, 4:], grid_run.run.std[-1, 0, 4:]
    np.testing.assert_array_less(np.abs(peak.point - mean), 0.3 * std)


@pytest.fixture(scope="module")
def four():
    model, P = four_gauges(loaded_chain()), start()[:5, :5]
    _, y = draw_truth(model, np.zeros(5), P, forces(LONG), range(10))
    return model, P, y


def broken(kind, y):
    y, t = y.copy(), np.arange(1, len(y) + 1) / len(y)
    rms = np.sqrt(np.mean(y**2, axis=0))
    if kind == "sign":
        y[:, 2] *= -1
        return y, Fault("sign", 2)
    if kind == "offset":
        y[:, 1] += 0.5 * rms[1]
        return y, Fault("offset", 1)
    if kind == "drift":
        y[:, 0] += rms[0] * t
        return y, Fault("drift", 0)
    if kind == "dead":
        y[:, 3] = NOISE * np.random.default_rng(3).standard_normal(len(y))
        return y, Fault("dead", 3)
    if kind == "clipped":
        y[:, 2] = np.clip(y[:, 2], -0.6 * np.abs(y[:, 2]).max(), 0.6 * np.abs(y[:, 2]).max())
        return y, Fault("clipped", 2)
    if kind == "late":
        y[4:, 1] = y[:-4, 1].copy()
        return y, Fault("late", 1, 4)
    if kind == "swapped":
        y[:, [0, 3]] = y[:, [3, 0]]
        return y, Fault("swapped", 0, 3)
    y[:, 1] *= kind
    return y, Fault("scale", 1, kind)


@pytest.mark.parametrize("kind", [1e-6, "late", *slowly("dead", "clipped")])
def test_a_fault_of_one_channel_is_named(four, kind):
    model, P, y = four
    samples, fault = broken(kind, y[:, 3])
    found = examine_record(suspect(model, P, forces(LONG), samples))
    assert found.inconsistent
    assert found.named.fault == fault


@pytest.mark.parametrize("factor", [1.25, 1.5])
def test_fitted_factor_is_named_with_its_size(four, factor):
    """Of all factors within 12 % it has the largest evidence."""
    model, P, y = four
    record = suspect(model, P, forces(LONG), broken(factor, y[:, 3])[0])
    found = examine_record(record).named
    assert found.fault.family == Fault("scale", 1, factor).family
    others = found.fault.amount * np.exp([-0.12, -0.06, -0.02, -0.005, 0.005, 0.02, 0.06, 0.12])
    evidence = [explain_record(record, Fault("scale", 1, other))[0].evidence for other in others]
    assert found.evidence > max(evidence)
    assert found.fault.amount == pytest.approx(factor, rel=0.05)


def gain_tolerance(model, std):
    """An independent gain of each of the four gauges."""
    rows = std * np.einsum("km,mn->kmn", np.eye(4), model.H[:, :5])
    return replace(none_considered(model), source=("gain",) * 4, D=rows, E=np.zeros((4, 4, 1)), offset=np.zeros((4, 4)))


def test_wider_tolerances_are_those_of_other_config(four):
    model, P, y = four
    record = suspect(model, P, forces(LONG), y[:, 0])
    wider = widen_tolerances(replace(record, considered=gain_tolerance(model, 0.01)), 3.0)
    expected = explain_record(replace(record, considered=gain_tolerance(model, 0.03)), None)[0].evidence
    assert explain_record(wider, None)[0].evidence == pytest.approx(expected, abs=1e-6)


def test_gauges_outside_their_tolerances_are_not_accused(four):
    """Gains that are 2 to 4 σ wrong in four gauges, and a channel 25 % high."""
    model, P, y = four
    record = replace(suspect(model, P, forces(LONG), y[:, 3]), considered=gain_tolerance(model, 0.01))
    poor = examine_record(replace(record, samples=y[:, 3] * [1.03, 0.97, 1.03, 0.96]))
    assert not poor.inconsistent
    assert poor.candidates == ()
    high = examine_record(replace(record, samples=y[:, 3] * [1.0, 1.25, 1.0, 1.0]))
    assert high.named.fault.family == Fault("scale", 1, 1.25).family


STRAIN = np.array([[1.0, 0.0], [-0.3, 0.2], [0.4, 1.1]])
"""ε_x, ε_y and γ_xy at the first gauge, by both masses."""


def mohr(degrees):
    """ε = ε_x cos²α + ε_y sin²α + γ_xy sin α cos α."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([c * c, s * s, s * c]) @ STRAIN


def test_a_turned_gauge_is_named_with_its_angle_and_not_as_a_factor(four):
    model, P, _ = four

    def read(angle):
        H = model.H.copy()
        H[0, :2] = mohr(angle)
        return replace(model, H=H)

    samples = draw_truth(read(62.0), np.zeros(5), P, forces(LONG), [3])[1][:, 0]
    straight, rows = read(0.0), np.full((4, len(ANGLES), model.size), np.nan)
    rows[0] = [read(angle).H[0] for angle in ANGLES]

    def turned(channel, angle):
        return read(angle), none_considered(model)

    mean = np.zeros(model.size)
    record, load = (straight, mean, P, forces(LONG), samples, none_considered(model)), np.arange(1)
    given = CheckRecord(*record, turned_rows=rows, turned=turned, load=load)
    found = examine_record(given)
    assert found.inconsistent
    assert found.named.fault == Fault("angle", 0, 60.0)
    sound = draw_truth(straight, np.zeros(5), P, forces(LONG), [3])[1][:, 0]
    assert not examine_record(replace(given, samples=sound)).inconsistent


def test_a_search_for_faults_in_a_sound_record_finds_none(four):
    model, P, y = four
    for one in range(y.shape[1]):
        assert not examine_record(suspect(model, P, forces(LONG), y[:, one])).inconsistent, one
    found = search_faults(suspect(model, P, forces(LONG), y[:, 0]))
    assert found.named is None
    assert found.candidates == ()
    assert found.best_of(0) is None or found.best_of(0).evidence - found.as_it_is.evidence < 5


def test_identical_channels_are_ambiguous(four):
    model, P, _ = four
    twin = replace(model, H=model.H[[0, 0]], r=model.r[:2])
    calm = 0 * forces(LONG)
    samples = draw_truth(twin, np.zeros(5), P, calm, [2])[1][:, 0]
    samples[3:, 1] = samples[:-3, 1].copy()
    found = examine_record(suspect(twin, P, calm, samples))
    assert found.inconsistent
    assert found.named is None
    assert {own.fault.channel for own in found.candidates} == {0, 1}


def test_no_fault_named_without_redundant_channels(four):
    model, P, y = four
    one = replace(model, H=model.H[:1], r=model.r[:1])
    samples = y[:, 0, :1] + 0.5 * np.sin(0.5 * np.arange(LONG))[:, None]
    found = examine_record(suspect(one, P, forces(LONG), samples))
    assert found.inconsistent
    assert found.candidates == ()
