"""Plain tests of a cantilever: what is known, what is not, which gauges; and sound records of `benchmarks/sound.py`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib.util import module_from_spec, spec_from_file_location

import numpy as np
import pytest

from strainsight.runner.artefact import Artefact

from ..shared import ROOT, slowly
from .conftest import invoked

E, DENSITY = 2.1e11, 7850.0
"""The truth [Pa, kg/m³]."""


def load_of(name: str, node: str, axis: str, frequency: float, amplitude: float, known: bool = False) -> str:
    model = "" if known else ", process_noise: {model: integrated_random_walk}"
    signal = f"{{type: sine, frequency: {frequency}, amplitude: {amplitude}}}"
    return f"{name}: {{node: {node}, direction: {axis}, known: {str(known).lower()}, signal: {signal}{model}}}"


X, Y, Z = "[1, 0, 0]", "[0, 1, 0]", "[0, 0, 1]"
TIP, SHAKER = load_of("tip", "2", Z, 20, 1e4, known=True), load_of("shaker", "2", Z, 35, 1e4, known=True)
AXIAL, SIDE, LIFT = load_of("axial", "2", X, 8, 1e5), load_of("side", "2", Y, 10, 3e3), load_of("lift", "2", Z, 5, 3e3)
MIDDLE = load_of("middle", "413", Z, 6, 8e3)
"""On top, halfway."""
MODULUS = "E: {property: youngs_modulus, region: 1, guess: 1.95e+11, range: [1.6e+11, 2.4e+11]}"
MASS = "rho: {property: density, region: 1, guess: 7400, range: [6000, 9500]}"


@dataclass(frozen=True)
class Case:
    """loads, parameters: lines of the config; unknown names; gauges; whether σ is withheld."""

    loads: tuple[str, ...]
    parameters: tuple[str, ...]
    unknown: tuple[str, ...]
    gauges: int = 4
    withheld: bool = False


CASES = {
    "modulus": Case((TIP,), (MODULUS,), ("E",)),
    "density": Case((SHAKER,), (MASS,), ("rho",)),
    "load": Case((SIDE,), (), ("side",)),
    "load-modulus-shaker": Case((SHAKER, SIDE), (MODULUS,), ("side", "E")),
    "two-loads": Case((SIDE, MIDDLE), (), ("side", "middle")),
    "three-loads-at-a-node": Case((AXIAL, SIDE, LIFT), (), ("axial", "side", "lift")),
    "one-gauge": Case((LIFT,), (), ("lift",), gauges=1),
    "parameters": Case((TIP, SHAKER), (MODULUS, MASS), ("E", "rho")),
    "nothing-known": Case((LIFT,), (MODULUS,), ("lift", "E"), withheld=True),
}
CONFIG = """
kind: placement
name: {name}
mesh: {{file: {deck}}}
parameters: {{{parameters}}}
loads: {{{loads}}}
damping: {{type: modal, ratio: 0.01}}
rom: {{modes: 4, parameter_samples: {samples}}}
train: {{duration: 0.12, time_step: 1.0e-3}}
gauges:
  direction: {{type: axis, axis: [1, 0, 0], angles: [0]}}
  include: [{{box: [[0.1, -1, -1], [1.4, 1, 1]]}}]
  exclude: [{{normal_cone: {{axis: [1, 0, 0], angle: 10}}}}]
  noise_std: {{relative_to_strongest: 0.01}}
tolerances: none
screen: {{keep: 12, minimum_spacing: 0.05}}
place: {{estimate: [{unknown}], keep: {gauges}, instants: 1, certificate: false}}
validate:
  truth: {{model: modes, modes: 12{truth}}}
  time_step: 1.0e-3
  duration: 0.12
  initial_std: {{{initial}}}
  random_sets: 0
  repeats: 1
  noise_factors: []
filter: {{compare: false}}
estimate:
  as_placed: true
  time: {{channel: time}}
  channels: [{channels}]
  inputs: {{{inputs}}}
"""


def config(name: str, case: Case) -> str:
    """The config of a case."""
    known = [load.split(":")[0] for load in case.loads if "known: true" in load]
    truth = {"E": f"E: {E:g}", "rho": f"rho: {DENSITY:g}"}
    labels = [f"G{i + 1}" for i in range(case.gauges)]
    parameters = [line.split(":")[0] for line in case.parameters]
    return CONFIG.format(
        name=name,
        deck=ROOT / "meshes" / "cantilever-coarse.bdf",
        parameters=", ".join(case.parameters),
        loads=", ".join(case.loads),
        samples=3 if parameters else 1,
        unknown=", ".join(case.unknown),
        gauges=case.gauges,
        truth=f", parameters: {{{', '.join(truth[p] for p in parameters)}}}" if parameters else "",
        initial=", ".join(f"{u}: {0.1 if u in parameters else 1.0}" for u in case.unknown),
        channels=", ".join(f"{{channel: {label}, gauge: {label}, unit: m/m}}" for label in labels),
        inputs=", ".join(f"{load}: {{channel: {load}, unit: N}}" for load in known),
    )


SETTLED = 0.05
"""Of the record: before it, what was stated of the start counts, and not the readings."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name == "modulus" else [pytest.mark.slow]) for name in CASES]
)
@pytest.mark.usefixtures("no_hot_spots")
def test_the_truth_is_within_three_sigma_or_sigma_is_withheld(tmp_path, name):
    (tmp_path / "own.yaml").write_text(config(name, CASES[name]))
    results = tmp_path / "results" / name
    words = [tmp_path / "own.yaml", "--results", tmp_path / "results"]
    invoked("validate", *words)
    message = invoked("estimate", *words, "--measurements", results / "measured.csv", "--no-page")
    truth, estimate = (Artefact(results / f"{stage}.h5") for stage in ("validate", "estimate"))
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
    end, ratio = sound.record(sound_folder, sound.Study("beam", "E", sensors, start), 1)
    assert end == "0"
    assert ratio < sound.MOST


@pytest.mark.slow
def test_a_record_whose_first_samples_ask_for_another_density_is_estimated(sound, sound_folder):
    end, ratio = sound.record(sound_folder, sound.Study("plate", "rho", "gauges", "settled"), 50)
    assert end == "0"
    assert ratio < sound.MOST


def test_an_accelerometer_does_not_tell_an_unknown_load_from_its_drift(sound, sound_folder):
    end, _ = sound.record(sound_folder, sound.Study("beam", "load", "accelerometer", "moving"), 1)
    assert end == "2: the 1 channel cannot determine tip"
