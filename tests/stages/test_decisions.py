"""What a record is judged to be, and verdicts on the claimed σ, in words."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.config.estimate import Estimate
from strainsight.errors import ConfigError
from strainsight.estimation import fault_search
from strainsight.estimation.decision import claims_of
from strainsight.experiment.structure import record_filter
from strainsight.experiment.structure.consistency import check_consistency
from strainsight.experiment.structure.measured import common_part, records_of
from strainsight.experiment.structure.problem import damping_dependence_text, load_dependence_text
from strainsight.experiment.structure.record_filter import RecordFilter, filter_by_consistency
from strainsight.measurements.assemble import Signals
from strainsight.text import number

from ..estimation.chain import H, forces, loaded_chain, start
from ..estimation.test_fault_search import suspect
from ..estimation.truth import draw_truth

STEPS = 80
ROWS = np.array([[1.0, 0.0], [-1.0, 1.0], [0.3, 1.0], [1.0, 0.002]])
NAMES = ("G1", "G2", "G3", "G4")


def settings(**second):
    """Of four channels, the second with more keys."""
    entries = [{"gauge": name, "channel": name, "unit": "m/m"} for name in NAMES]
    entries[1] |= second
    return Estimate.model_validate({"file": "test.csv", "channels": tuple(entries)})


def records(which):
    """The suspects of simulated records."""
    model, P = loaded_chain(), start()[:5, :5]
    model = replace(model, H=np.hstack([ROWS, np.zeros((4, 3))]), r=np.repeat(model.r[:1], 4))
    _, y = draw_truth(model, np.zeros(5), P, forces(STEPS), which)
    return [suspect(model, P, forces(STEPS), y[:, i]) for i in range(len(which))]


def judged(record, own=None, **second):
    own = own or records_of(settings(**second))[0]
    test = SimpleNamespace(labels=NAMES, time=H * np.arange(len(record.samples) + 1), record=own)
    return check_consistency(test, SimpleNamespace(known=()), record, 0.0, lambda share: None)


def test_nothing_is_shown_as_an_explanation_of_a_record_that_agrees(monkeypatch):
    """Also where its faults are looked for: two channels that read nearly the same fit swapped in every other record."""
    monkeypatch.setattr(fault_search, "needs_fault_search", lambda *_: True)
    chance = 0
    for record in records([2, 3]):
        found = judged(record)
        assert found.trusted
        assert not found.words
        assert found.check.by_others
        assert set(found.check.fault) == {""}
        assert not found.check.gain.any()
        swapped = fault_search.explain_record(record, fault_search.Fault("swapped", 0, 3))[0]
        chance += swapped.evidence > fault_search.explain_record(record, None)[0].evidence
    assert chance


@pytest.mark.parametrize(
    ("second", "key"),
    [
        ({}, "{samples: 4}"),
        ({"delay": {"samples": -1}}, "{samples: 3}"),
        ({"delay": {"seconds": 0.02}}, "{seconds: 0.1}"),
    ],
)
def test_a_late_channel_is_named_with_the_delay_that_puts_it_right(second, key):
    """A sample every 0.02 s; the delay that the config has already is counted in."""
    (record,) = records([0])
    samples = record.samples.copy()
    samples[4:, 1], samples[:4, 1] = record.samples[:-4, 1], np.nan
    found = judged(replace(record, samples=samples), **second)
    assert not found.trusted
    assert found.named == f"G2 is 4 samples (0.08 s) late: set estimate.channels.1.delay: {key}"


def test_record_ends_where_known_loads_have_no_samples():
    values = np.array([[1.0, np.nan], [2.0, np.nan], [np.nan, 3.0], [4.0, 5.0], [6.0, 7.0], [8.0, np.nan]])
    given = Signals(0.1 * np.arange(6), values, ("g", "F"), ("strain", "force"), ())
    for moved in (True, False):
        found = common_part(given, 1, [moved], "moving")
        np.testing.assert_array_equal(found.values, values[2:5])
        np.testing.assert_array_equal(found.time, given.time[2:5])
        assert found.notes == ("samples at the ends of the record that were removed because a known load is missing: 3",)
    with pytest.raises(ConfigError, match=r"no samples in the first 0\.2 s"):
        common_part(given, 1, [False], "rest")
    assert common_part(given, 2, [], "rest") is given
    far = replace(given, time=0.1 * np.arange(40), values=np.vstack([values[2:5], np.full((37, 2), np.nan)]))
    assert common_part(far, 1, [False], "rest") is far
    assert len(common_part(far, 1, [True], "rest").time) == 3


@pytest.mark.parametrize(
    ("agrees", "parts"),
    [
        ([True] * 4, [((0, 1, 2, 3), (2, 0, 3, 1))]),
        ([True, False, True, False], [((0, 2), (0, 1)), ((1,), (0,)), ((3,), (0,))]),
    ],
)
def test_records_that_agree_are_filtered_together_and_every_other_by_itself(monkeypatch, agrees, parts):
    """Records, marked by their start, with their places in the order of their names; what is found is in their order."""
    each = [RecordFilter(None, None, None, None, i, None, place, 4) for i, place in enumerate((2, 0, 3, 1))]
    seen, shares = [], []

    def together(own, wanted, progress):
        assert {given.records for given in own} == {len(own)}
        seen.append((tuple(given.start for given in own), tuple(given.record for given in own)))
        progress(1.0)
        return tuple(f"of {given.start}" for given in own)

    monkeypatch.setattr(record_filter, "filter_together", together)
    assert filter_by_consistency(each, agrees, None, shares.append) == ("of 0", "of 1", "of 2", "of 3")
    assert seen == parts
    assert shares[-1] == 1.0
    assert shares == sorted(shares)


@pytest.mark.parametrize(
    ("numbers", "repeats", "found"),
    [
        # errors of twice σ in every one of twenty repeats, which one draw may have by chance
        ({"error.a": 2.0}, [2.0] * 20, [("repeats", "overconfident"), ("test", "consistent")]),
        ({"error.a": 2.0}, [], [("test", "consistent")]),
        ({"error.a": 2.0, "draws.a": 50}, [1.0] * 20, [("test", "overconfident")]),
        ({"smoothed.a": 5.0, "zero.a": False}, [1.0] * 20, [("smoothed", "overconfident")]),
        # errors far below σ are no fault
        ({"error.a": 0.5}, [0.1] * 20, [("repeats", "too cautious"), ("test", "consistent")]),
    ],
)
def test_sigma_is_held_against_repeats_the_draws_of_the_test_and_the_smoothed_error(numbers, repeats, found):
    usual = dict.fromkeys(("error.a", "std.a", "smoothed.a", "smoothed_std.a", "draws.a", "smoothed_draws.a"), 1)
    claims = claims_of("a", usual | numbers, (np.array(repeats), np.ones(len(repeats))))
    assert [(claim.of, claim.result) for claim in claims][: len(found)] == found
    assert claims[0].words(number).startswith(found[0][1])


@pytest.mark.parametrize(
    ("known", "inputs", "parameters", "alone", "together"),
    [
        (("tip",), ("x",), ("E",), "", ""),
        ((), ("x",), (), "", ""),
        ((), (), ("E",), "", ""),
        ((), ("x", "y"), ("E", "rho"), "the estimates of E, rho depend on the process_noise of x, y", ""),
        (("tip",), ("x", "y"), ("E", "zeta"), "", "the damping factor zeta is also unknown, so σ of E depends on"),
        (("tip",), ("x",), ("zeta",), "", ""),
        (("tip",), (), ("E", "zeta"), "", ""),
        ((), ("x",), ("E", "zeta"), "the estimates of E, zeta depend on", ""),
    ],
)
def test_parameters_rest_on_loads_where_none_is_known_or_with_a_damping_factor(known, inputs, parameters, alone, together):
    unknowns = SimpleNamespace(inputs=inputs, parameters=parameters)
    model = SimpleNamespace(damping=SimpleNamespace(parameter="zeta"))
    own = SimpleNamespace(known=known, unknowns=unknowns, model=model)
    for said, expected in ((load_dependence_text(own), alone), (damping_dependence_text(own), together)):
        assert expected in said
        assert bool(said) == bool(expected)
