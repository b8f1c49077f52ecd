"""What a record is judged to be, in words: on two masses with four gauges, two of which read nearly the same."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from strainsight.cases.structure.diagnosed import judgement_of
from strainsight.cases.structure.records_of_test import records_of
from strainsight.config.estimate import Estimate
from strainsight.estimation import fault_search
from strainsight.estimation.draws import draw_truth

from ..estimation.chain import forces, loaded_chain, start
from ..estimation.test_fault_search import suspect

STEPS = 80
ROWS = np.array([[1.0, 0.0], [-1.0, 1.0], [0.3, 1.0], [1.0, 0.002]])
NAMES = ("G1", "G2", "G3", "G4")
SETTINGS = Estimate.model_validate(
    {"file": "test.csv", "channels": tuple({"gauge": name, "channel": name, "unit": "m/m"} for name in NAMES)}
)


def records(which):
    """The suspects of simulated records."""
    model, P = loaded_chain(), start()[:5, :5]
    model = replace(model, H=np.hstack([ROWS, np.zeros((4, 3))]), r=np.repeat(model.r[:1], 4))
    _, y = draw_truth(model, np.zeros(5), P, forces(STEPS), which)
    return [suspect(model, P, forces(STEPS), y[:, i]) for i in range(len(which))]


def judged(record):
    (own,) = records_of(SETTINGS)
    return judgement_of(own, SimpleNamespace(labels=NAMES), None, record, 0.0, lambda share: None)


def test_nothing_is_shown_as_an_explanation_of_a_record_that_agrees(monkeypatch):
    """Also where its faults are looked for: two channels that read nearly the same fit swapped in every other record."""
    monkeypatch.setattr(fault_search, "suspected", lambda *_: True)
    chance = 0
    for record in records([2, 3]):
        found = judged(record)
        assert found.trusted
        assert not found.words
        assert found.check.by_others
        assert set(found.check.fault) == {""}
        assert not found.check.gain.any()
        swapped = fault_search.explained(record, fault_search.Fault("swapped", 0, 3))[0]
        chance += swapped.evidence > fault_search.explained(record, None)[0].evidence
    assert chance
