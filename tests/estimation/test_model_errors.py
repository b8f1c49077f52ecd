"""Errors of the model as causes of inconsistent measurements: what they change, and that no sensor is named for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation import fault_search, hum
from strainsight.estimation.conditional import none_considered
from strainsight.estimation.fault_evidence import explain_record, shifted_mode
from strainsight.estimation.fault_search import examine_record
from strainsight.estimation.faults import Explained, Fault
from strainsight.estimation.model_errors import WIDER, add_constant, apply_model_error, further, model_errors
from strainsight.rom.model import modal_basis

from .chain import driven_chain, driven_start
from .test_fault_search import FOUR, suspect
from .test_faults import FORCE, held
from .truth import draw_truth

START = driven_start()[:4, :4]
FREQUENCIES = np.vstack([0.01 * np.ones((1, 2)), 0.005 * np.eye(2)])


def chain():
    model = driven_chain(parameters=())
    return replace(model, H=np.hstack([FOUR, np.zeros((4, 2))]), r=np.repeat(model.r[:1], 4))


def record_of(truth, model):
    """A record of a truth, filtered by a model."""
    _, y = draw_truth(truth, np.zeros(truth.size), START, held(FORCE), [4])
    found = suspect(model, START, held(FORCE), y[:, 0])
    return replace(found, considered=replace(found.considered, frequency=FREQUENCIES))


@pytest.fixture(scope="module")
def record():
    return record_of(chain(), chain())


def frequencies(record):
    rom = record.model.model
    return np.sqrt(modal_basis(rom, rom.reference)[0])


@pytest.mark.parametrize("mode", [0, 1])
def test_one_frequency_is_changed_and_the_static_response_is_not(record, mode):
    changed = apply_model_error(record, Fault("frequency", mode, 0.9))
    factors = np.where(np.arange(2) == mode, 0.9, 1.0)
    np.testing.assert_allclose(frequencies(changed), factors * frequencies(record), rtol=1e-12)
    before, after = (each.model.model.stiffness.at(each.model.model.reference) for each in (record, changed))
    np.testing.assert_array_equal(before, after)


def test_an_added_mass_lowers_the_first_frequency_by_the_first_step(record):
    """To first order in the mass; M + m s sᵀ is the mass matrix with m at the point of the load."""
    error, *_ = (one for one in model_errors(record.model, record.considered) if one.kind == "mass")
    assert frequencies(apply_model_error(record, error))[0] / frequencies(record)[0] == pytest.approx(0.995, abs=2e-4)
    rom, s = record.model.model, record.model.model.input_shape[:, 0]
    heavier = apply_model_error(record, further(error)).model.model.mass.at(rom.reference)
    np.testing.assert_allclose(heavier, rom.mass.at(rom.reference) + 2 * error.amount * np.outer(s, s), rtol=1e-12)


def test_an_added_mass_moves_in_the_directions_that_the_tolerance_of_the_load_knows(record):
    """With σ = 0.02 rad of a rotation, its shape is the change over σ, and the mass m(s sᵀ + t tᵀ)."""
    aside = np.array([0.3, -0.2])
    shape = np.zeros((1, *record.model.model.input_shape.shape))
    shape[0, :, 0] = 0.02 * aside
    one = {name: np.zeros((1, *getattr(record.considered, name).shape[1:])) for name in ("D", "E", "offset")}
    turned = {"source": ("load direction",), "shape": shape, "load": np.zeros(1, dtype=int), "load_std": np.full(1, 0.02)}
    wider = replace(record, considered=replace(record.considered, **one, **turned, B=None))
    error, *_ = (each for each in model_errors(wider.model, wider.considered) if each.kind == "mass")
    rom, s = record.model.model, record.model.model.input_shape[:, 0]
    heavier = apply_model_error(wider, error).model.model.mass.at(rom.reference)
    expected = rom.mass.at(rom.reference) + error.amount * (np.outer(s, s) + np.outer(aside, aside))
    np.testing.assert_allclose(heavier, expected, rtol=1e-12)


def test_damping_is_scaled(record):
    changed = apply_model_error(record, Fault("damping", 0, 3.0)).model.model.damping
    before = record.model.model.damping
    lam = np.array([100.0, 900.0])
    np.testing.assert_allclose(changed.viscous(lam)[0], 3 * before.viscous(lam)[0])


def test_a_wrong_direction_widens_direction_and_point_of_loads_alone(record):
    both = none_considered(record.model)
    for source in ("load direction", "load gain", "gain"):
        both = add_constant(both, source, record.known, offset=np.ones(4))
    both = replace(both, shape=np.ones((2, 2, 1)))
    wider = apply_model_error(replace(record, considered=both), Fault("direction", 0)).considered
    np.testing.assert_array_equal(wider.offset, [[WIDER] * 4, [1.0] * 4, [1.0] * 4])
    np.testing.assert_array_equal(wider.shape, [WIDER * both.shape[0], both.shape[1]])


def test_warming_is_one_ramp_on_all_channels(record):
    constant = apply_model_error(record, Fault("warming", 0)).considered
    assert constant.source == ("warming",)
    largest = np.sqrt(np.max(np.mean(record.samples**2, axis=0)))
    np.testing.assert_allclose(constant.E[0], [[0.0, largest]] * 4)


TRUTHS = {
    "frequency": (Fault("frequency", 0, 0.75), {"frequency", "mass"}),
    "mass": (Fault("mass", 0, 1.5), {"frequency", "mass"}),
    "damping": (Fault("damping", 0, 8.0), {"damping"}),
}


@pytest.mark.parametrize("name", TRUTHS)
def test_a_wrong_model_is_named_and_no_sensor(record, name):
    error, kinds = TRUTHS[name]
    found = examine_record(record_of(apply_model_error(record, error).model, chain()))
    assert found.inconsistent
    assert found.candidates
    assert {one.fault.kind for one in found.candidates} <= kinds


def test_a_reversed_channel_is_no_error_of_the_model(record):
    found = examine_record(replace(record, samples=record.samples * [1, -1, 1, 1]))
    assert found.named.fault == Fault("sign", 1)


def test_shifts_over_what_their_tolerance_predicts_are_normal(record):
    """z of 25 records with frequencies drawn from the tolerance: RMS 1."""
    rng, sizes = np.random.default_rng(4), []
    for _ in range(25):
        factors = np.exp(rng.standard_normal(3) @ FREQUENCIES)
        truth = record
        for mode, factor in enumerate(factors):
            truth = apply_model_error(truth, Fault("frequency", mode, factor))
        drawn = record_of(truth.model, chain())
        _, grid_run = explain_record(drawn, None)
        shift = shifted_mode(drawn.model, drawn.considered, grid_run, limit=0.0)
        sizes.append(shift.size)
    assert 0.8 < np.sqrt(np.mean(np.square(sizes))) < 1.6


def test_a_fault_is_named_although_no_filter_follows_the_record_as_it_is(record, monkeypatch):
    """ln p = −∞ without a fault is no reference for what the model of the loads does not resolve."""
    lost = Explained(None, -np.inf, np.inf), None
    monkeypatch.setattr(fault_search, "model_errors", lambda model, considered: [])
    found = fault_search.search_faults(replace(record, samples=record.samples * [1, -1, 1, 1]), first=lost)
    assert found.named.fault == Fault("sign", 1)


def test_warming_of_a_later_part_continues_the_ramp(record):
    """Samples 300 to 600 of a record: the ramp is a half at their begin and whole at their end."""
    later = apply_model_error(record, Fault("warming", 0), before=0.5).considered
    np.testing.assert_allclose(later.offset[0], later.E[0, :, -1])
    largest = np.sqrt(np.max(np.mean(record.samples**2, axis=0)))
    np.testing.assert_allclose(later.offset[0] + later.E[0, :, -1], largest)


def test_mains_hum_is_fitted_at_its_frequency_and_leaves_a_consistent_record(record, monkeypatch):
    """A common sine of five times the noise: afterwards ln p is that of the record without it, less ln T, but for chance."""
    f = 11.5
    monkeypatch.setattr(hum, "MAINS", (9.0, f, 14.0))
    time = record.model.h * record.model.every * (1 + np.arange(len(record.samples)))
    loud = replace(record, samples=record.samples + 5 * record.noise.max() * np.sin(2 * np.pi * f * time + 1)[:, None])
    (clean, _), (fit, run) = explain_record(record, None), explain_record(loud, None)
    assert fit.ratio > 3
    explained = hum.explain_hum(loud, fit, run)
    assert explained.fault == Fault("hum", 0, f)
    assert explained.ratio == pytest.approx(clean.ratio, abs=0.05)
    assert explained.evidence == pytest.approx(clean.evidence - np.log(record.samples.size), abs=6)
    assert hum.explain_hum(record, clean, explain_record(record, None)[1]).evidence < clean.evidence
