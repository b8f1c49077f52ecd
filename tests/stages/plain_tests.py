"""Plain tests of a cantilever: what is known, what is not, which gauges; and their records."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from ..shared import ROOT, once, without_hot_spots

DECK = ROOT / "meshes" / "cantilever-coarse.bdf"
E, DENSITY = 2.1e11, 7850.0
"""The truth [Pa, kg/m³]."""


def _load(name: str, node: str, axis: str, frequency: float, amplitude: float, known: bool = False) -> str:
    model = "" if known else ", process_noise: {model: integrated_random_walk}"
    signal = f"{{type: sine, frequency: {frequency}, amplitude: {amplitude}}}"
    return f"{name}: {{node: {node}, direction: {axis}, known: {str(known).lower()}, signal: {signal}{model}}}"


X, Y, Z = "[1, 0, 0]", "[0, 1, 0]", "[0, 0, 1]"
TIP, SHAKER = _load("tip", "2", Z, 20, 1e4, known=True), _load("shaker", "2", Z, 35, 1e4, known=True)
AXIAL, SIDE, LIFT = _load("axial", "2", X, 8, 1e5), _load("side", "2", Y, 10, 3e3), _load("lift", "2", Z, 5, 3e3)
MIDDLE = _load("middle", "MIDDLE", Z, 6, 8e3)
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


def config(name: str, case: Case, deck: Path, node: int) -> str:
    """The config of a case."""
    known = [load.split(":")[0] for load in case.loads if "known: true" in load]
    truth = {"E": f"E: {E:g}", "rho": f"rho: {DENSITY:g}"}
    labels = [f"G{i + 1}" for i in range(case.gauges)]
    parameters = [line.split(":")[0] for line in case.parameters]
    return CONFIG.format(
        name=name,
        deck=deck,
        parameters=", ".join(case.parameters),
        loads=", ".join(case.loads).replace("MIDDLE", str(node)),
        samples=3 if parameters else 1,
        unknown=", ".join(case.unknown),
        gauges=case.gauges,
        truth=f", parameters: {{{', '.join(truth[p] for p in parameters)}}}" if parameters else "",
        initial=", ".join(f"{u}: {0.1 if u in parameters else 1.0}" for u in case.unknown),
        channels=", ".join(f"{{channel: {label}, gauge: {label}, unit: m/m}}" for label in labels),
        inputs=", ".join(f"{load}: {{channel: {load}, unit: N}}" for load in known),
    )


def invoked(*words: object) -> str:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


def node_at(deck: Path, place: tuple[float, float, float]) -> int:
    """The node of a deck in small fields at a place."""
    for line in deck.read_text().splitlines():
        if line.startswith("GRID"):
            x = [float(line[k : k + 8]) for k in (24, 32, 40)]
            if np.allclose(x, place):
                return int(line[8:16])
    raise AssertionError(place)


def recorded(folder: Path, name: str) -> Path:
    """The folder of the config of a case with its results up to validate, in a copy."""
    text = config(name, CASES[name], DECK, 0)
    shutil.copytree(once("plain", text, lambda place: _record(place, name)), folder, dirs_exist_ok=True)
    return folder


def _record(folder: Path, name: str) -> None:
    path = folder / f"{name}.yaml"
    path.write_text(config(name, CASES[name], DECK, node_at(DECK, (1.0, 0.0, 0.095))))
    with without_hot_spots():
        invoked("validate", path, "--results", folder / "results")


def estimated(folder: Path, name: str) -> tuple[Artefact, str]:
    """The estimate of what validate has measured, and what is printed."""
    results = folder / "results"
    words = ["--results", results, "--measurements", results / name / "measured.csv", "--no-page"]
    message = invoked("estimate", folder / f"{name}.yaml", *words)
    return Artefact(results / name / "estimate.h5"), message
