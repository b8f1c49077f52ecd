"""What is said of an error of the model, with the quantity and what to check."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.estimation.fault_evidence import ShiftedMode
from strainsight.estimation.fault_search import Diagnosis
from strainsight.estimation.faults import ChannelCheck, Explained, Fault
from strainsight.estimation.load_faults import ResidualPattern
from strainsight.estimation.record_check import RecordCheck
from strainsight.experiment.structure import consistency
from strainsight.experiment.structure.fault_text import FaultInWords, inspection_in_words
from strainsight.rom.model import modal_basis

from ..estimation.chain import driven_chain

MODEL = driven_chain(parameters=())
FIRST = np.sqrt(modal_basis(MODEL.model, MODEL.model.reference)[0][0]) / (2 * np.pi)
TEXTS = {
    Fault("frequency", 0, 0.9): (f"mode 1 is measured at {0.9 * FIRST:.4g} Hz and modelled at {FIRST:.4g} Hz", "check masses"),
    Fault("mass", 0, 0.134): (f"a mass of 0.13 kg at the load {MODEL.model.inputs[0]} is missing in the model", "add the masses"),
    Fault("damping", 0, 3.0): ("the damping ratios are about 3 times those of the model", "correct `damping`"),
    Fault("direction", 0): ("a load has another direction or point of application than in the model", "check direction"),
    Fault("warming", 0): ("all strain gauges drift together", "compensate the temperature"),
    Fault("gain", 0): ("all strain gauges have a common gain error", "check bridge supply"),
    Fault("hum", 0, 50.0): ("all channels contain a common sine of 50 Hz", "remove the mains hum"),
}


@pytest.mark.parametrize("fault", TEXTS, ids=lambda fault: fault.kind)
def test_error_of_the_model_is_named_with_its_size_and_remedy(fault):
    stretch = SimpleNamespace(model=MODEL)
    texts = FaultInWords(SimpleNamespace(record=None), stretch)
    what, remedy = texts.of(Explained(fault, 0.0, 1.0))
    assert what == TEXTS[fault][0]
    assert remedy.startswith(TEXTS[fault][1])


@pytest.mark.parametrize(
    ("kinds", "places"),
    [
        ("frequency mass", "masses, supports, damping and loads of the model"),
        ("sign angle", "the gauges on the structure (estimate.channels)"),
        ("gain hum", "the gauges on the structure (estimate.channels)"),
        ("scale damping", "the gauges on the structure (estimate.channels) and masses, supports, damping and loads of the model"),
    ],
)
def test_what_is_inspected_follows_the_candidates(kinds, places):
    assert inspection_in_words([Fault(kind, 0) for kind in kinds.split()], "estimate.channels") == f"Inspect {places}"
    loads = [Fault(kind, 0, of_load=True) for kind in ("sign", "late")]
    assert inspection_in_words(loads, "estimate.channels") == "Inspect the measurement of the known loads"


@pytest.mark.parametrize(("amount", "key"), [(1.2345, ""), (2.0, "set estimate.channels.0.scale: 0.5")])
def test_only_usual_factors_have_a_scale_to_set(amount, key):
    """A fitted factor contains the installation of the gauge."""
    entry = SimpleNamespace(sign=1, scale=1.0, unit="m/m")
    settings = SimpleNamespace(channels=[entry])
    record = SimpleNamespace(section="estimate", channels="estimate.channels", inputs="estimate.inputs", settings=settings)
    texts = FaultInWords(SimpleNamespace(labels=("G1",), record=record), SimpleNamespace(model=MODEL))
    what, remedy = texts.of(Explained(Fault("scale", 0, amount), 0.0, 1.0, amount))
    assert what == f"the readings of G1 are {amount:.3g} times as large as expected"
    assert ("scale:" in remedy) == bool(key)
    assert key in remedy


def test_every_candidate_is_listed_with_its_odds(monkeypatch):
    """Five causes; evidence ln 4 below the best is odds of a quarter."""
    below = (0.0, np.log(4), 1.0, 2.0, np.log(1000))
    causes = [Fault("damping", 0, 3.0), Fault("warming", 0), Fault("gain", 0), Fault("direction", 0), Fault("hum", 0, 50.0)]
    candidates = tuple(Explained(cause, 100.0 - size, 1.0) for cause, size in zip(causes, below, strict=True))
    channels = ChannelCheck(*np.ones((4, 2)), by_others=True)
    finding = Diagnosis(True, Explained(None, 0.0, 5.0), channels, candidates=candidates)
    check = RecordCheck(finding, SimpleNamespace(model=MODEL), (0, 0, 9.0), (0, 2))
    monkeypatch.setattr(consistency, "check_record", lambda *_: check)
    test = SimpleNamespace(labels=("G1", "G2"), time=np.arange(4.0), record=SimpleNamespace(channels="estimate.channels"))
    result = consistency.check_consistency(test, SimpleNamespace(known=(), model=MODEL.model), None, 0.0, lambda share: None)
    odds = ["1", "0.25", "0.37", "0.14", "0.001"]
    assert result.check.candidate == tuple(
        f"{TEXTS[cause][0]} (odds {each})" for cause, each in zip(causes, odds, strict=True)
    )
    assert all(text in result.words for text in result.check.candidate)
    assert result.named == ""


@pytest.mark.parametrize("cause", ["shifted", "pattern"])
def test_a_cause_of_the_model_is_the_one_message(monkeypatch, cause):
    """Words, `fault` of the summary and candidates of the artefact name it, and no sentence denies it."""
    shifted, pattern = ShiftedMode(0, 0.9, 6.0), ResidualPattern(8.0, 0.9, np.array([0.2, 0.8]), 100.0)
    channels = ChannelCheck(*np.ones((4, 2)), by_others=True)
    finding = Diagnosis(True, Explained(None, 0.0, 5.0), channels, **{cause: {"shifted": shifted, "pattern": pattern}[cause]})
    check = RecordCheck(finding, SimpleNamespace(model=MODEL), (0, 0, 9.0), (0, 2))
    monkeypatch.setattr(consistency, "check_record", lambda *_: check)
    test = SimpleNamespace(labels=("G1", "G2"), time=np.arange(4.0), record=SimpleNamespace(channels="estimate.channels"))
    result = consistency.check_consistency(test, SimpleNamespace(known=(), model=MODEL.model), None, 0.0, lambda share: None)
    assert {"shifted": "mode 1 is measured at", "pattern": "an unmodelled load, inertia force"}[cause] in result.named
    assert result.words == f"the measurements are inconsistent with the model: {result.named}"
    assert result.check.candidate == (result.named,)
    assert "no single fault" not in result.words
