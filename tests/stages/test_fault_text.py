"""What is said of an error of the model, with the quantity and what to check."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.estimation.faults import Explained, Fault
from strainsight.experiment.structure.fault_text import FaultInWords
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
