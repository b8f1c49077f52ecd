"""Sound records of `benchmarks/sound.py`: estimated, neither refused nor accused, and within 4σ."""

from __future__ import annotations

import sys
from importlib.util import module_from_spec, spec_from_file_location

import pytest

from ..shared import slowly
from .conftest import ROOT


@pytest.fixture(scope="module")
def sound():
    spec = spec_from_file_location("sound_records", ROOT / "benchmarks" / "sound.py")
    module = sys.modules[spec.name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("sound")


@pytest.mark.parametrize(
    ("sensors", "start"),
    [("accelerometer", "settled"), *slowly(("accelerometer", "moving"), ("gauges", "settled"))],
)
def test_a_sound_record_of_a_modulus_is_estimated(sound, folder, sensors, start):
    """One accelerometer was refused; four gauges in a settled motion chose a resonance by their first samples."""
    end, ratio = sound.record(folder, sound.Study("beam", "E", sensors, start), 1)
    assert end == "0"
    assert ratio < sound.MOST


@pytest.mark.slow
def test_a_record_whose_first_samples_ask_for_another_density_is_estimated(sound, folder):
    """The lattice moved on the way, and was laid finer where it had come from, without end."""
    end, ratio = sound.record(folder, sound.Study("plate", "rho", "gauges", "settled"), 50)
    assert end == "0"
    assert ratio < sound.MOST


def test_an_accelerometer_does_not_tell_an_unknown_load_from_its_drift(sound, folder):
    end, _ = sound.record(folder, sound.Study("beam", "load", "accelerometer", "moving"), 1)
    assert end == "2: the 1 channels cannot tell tip"
