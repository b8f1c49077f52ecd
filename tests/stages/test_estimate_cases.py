"""estimate in every plain case, and sound records of `benchmarks/sound.py`."""

from __future__ import annotations

import sys
from importlib.util import module_from_spec, spec_from_file_location

import numpy as np
import pytest

from strainsight.workflow.artefact import Artefact

from ..shared import slowly
from .conftest import ROOT
from .plain_tests import CASES, DENSITY, E, estimated, recorded

SETTLED = 0.05
"""Of the record: before it, what was stated of the start counts, and not the readings."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name == "modulus" else [pytest.mark.slow]) for name in CASES]
)
def test_the_truth_is_within_three_sigma_or_sigma_is_withheld(tmp_path, name):
    estimate, message = estimated(recorded(tmp_path, name), name)
    truth = Artefact(tmp_path / "results" / name / "validate.h5")
    late = slice(round(SETTLED * len(estimate["/time"])), None)
    for unknown in CASES[name].unknown:
        parameter = {"E": E, "rho": DENSITY}.get(unknown)
        if CASES[name].withheld:
            assert np.isnan(estimate[f"/std/{unknown}"]).all()
            assert f"std.{unknown}" not in estimate.summary
        elif parameter is not None:
            mean, std = estimate[f"/estimate/{unknown}"][-1], estimate[f"/std/{unknown}"][-1]
            assert abs(mean - parameter) < 3 * std
            assert std < 0.05 * parameter
        else:
            load = truth[f"/truth/{unknown}"]
            error = (estimate[f"/smoothed/{unknown}"] - load)[late] / estimate[f"/smoothed_std/{unknown}"][late]
            assert np.sqrt(np.mean(error**2)) < 1.5
            assert np.mean(np.abs(error) < 3) > 0.97
    assert ("σ is withheld" in message) == CASES[name].withheld


@pytest.fixture(scope="module")
def sound():
    spec = spec_from_file_location("sound_records", ROOT / "benchmarks" / "sound.py")
    module = sys.modules[spec.name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture(scope="module")
def sound_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("sound")


@pytest.mark.parametrize(
    ("sensors", "start"),
    [("accelerometer", "settled"), *slowly(("accelerometer", "moving"), ("gauges", "settled"))],
)
def test_a_sound_record_of_a_modulus_is_estimated(sound, sound_folder, sensors, start):
    """One accelerometer was refused; four gauges in a settled motion chose a resonance by their first samples."""
    end, ratio = sound.record(sound_folder, sound.Study("beam", "E", sensors, start), 1)
    assert end == "0"
    assert ratio < sound.MOST


@pytest.mark.slow
def test_a_record_whose_first_samples_ask_for_another_density_is_estimated(sound, sound_folder):
    """The lattice moved on the way, and was laid finer where it had come from, without end."""
    end, ratio = sound.record(sound_folder, sound.Study("plate", "rho", "gauges", "settled"), 50)
    assert end == "0"
    assert ratio < sound.MOST


def test_an_accelerometer_does_not_tell_an_unknown_load_from_its_drift(sound, sound_folder):
    end, _ = sound.record(sound_folder, sound.Study("beam", "load", "accelerometer", "moving"), 1)
    assert end == "2: the 1 channels cannot tell tip"
