"""Records of a shell frame with one wrong channel, through the check of `estimate`; installation by the default tolerances."""

from __future__ import annotations

import sys
from importlib import import_module

import numpy as np
import pytest

from strainsight.estimation.record_check import check_record

from ..shared import ROOT

sys.path.insert(0, str(ROOT))
faults = import_module("benchmarks.faults")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def study():
    return faults.study_of("portal, load")


@pytest.mark.parametrize("number", range(7))
def test_wrong_channel_is_named_and_no_rotation_alone(study, number):
    samples, fault = faults.with_fault(study, faults.PART_FAULTS[number], number + 1)
    finding = check_record(faults.suspect(study, samples), study.tolerances.discrepancy).finding
    assert faults.outcome(finding, fault) in ("named", "among candidates")
    assert {one.fault.kind for one in finding.candidates} != {"angle"}


@pytest.mark.parametrize("number", range(100, 104))
def test_sound_record_of_rough_installation_is_not_accused(study, number):
    sound = faults.record(study, number)
    assert np.isfinite(sound).all()
    assert not check_record(faults.suspect(study, sound), study.tolerances.discrepancy).finding.inconsistent


def test_rotation_is_not_named_if_a_factor_within_the_tolerances_is_more_likely():
    """On the jib, record 109 has a gauge 2.5σ and 1.8σ off, which reads 18 % low. A factor of 0.864, within 4.5σ of the
    installation, is more likely than a rotation by 15°."""
    jib = faults.study_of("jib, load")
    finding = check_record(faults.suspect(jib, faults.record(jib, 109)), jib.tolerances.discrepancy).finding
    best = max((one for one in finding.tried if one.fault is not None), key=lambda one: one.evidence)
    assert best.fault.fitted
    assert best.fault.amount == pytest.approx(0.864, abs=0.005)
    assert not finding.inconsistent
