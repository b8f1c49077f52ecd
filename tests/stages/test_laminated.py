"""A strip of plies from its deck to an estimate: the factor of its stiffness is found; what no laminate has is refused."""

from __future__ import annotations

import pytest

from strainsight.config.template import template
from strainsight.errors import StrainsightError
from strainsight.stages.placement import PLACEMENT
from strainsight.stages.suggestion import suggestion

from ..shared import job_of, stages_of
from .conftest import finished

N, M, A, B = 10, 2, 0.3, 0.03


def deck(path):
    lines = ["BEGIN BULK"]
    for i in range(N + 1):
        lines += [f"GRID,{1 + i * (M + 1) + j},,{i * A / N:.6f},{j * B / M:.6f},0." for j in range(M + 1)]
    for i in range(N):
        for j in range(M):
            k = 1 + i * (M + 1) + j
            lines.append(f"CQUAD4,{100 + i * M + j},1,{k},{k + M + 1},{k + M + 2},{k + 1}")
    lines += [
        "PCOMP,1,,,,,,,SYM",
        ",8,.0005,0.,,8,.0005,90.,",
        ",8,.0005,30.",
        "MAT8,8,1.4+11,1.+10,.3,5.+9,4.+9,3.+9,1600.",
        "SPC1,1,123456,1,2,3",
        "ENDDATA",
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


CONFIG = """
kind: placement
name: strip
mesh: {file: strip.bdf}
parameters:
  s: {property: stiffness_factor, region: 1, guess: 1.0, range: [0.8, 1.25]}
loads:
  tip: {node: 32, direction: [0, 0, 1], known: true, signal: {type: sine, frequency: 15.0, amplitude: 5.0}}
damping: {type: modal, ratio: 0.01}
rom: {modes: 6}
train: {duration: 0.1, time_step: 1.0e-3}
gauges: {direction: {type: axis, axis: [1, 0, 0]}, clearance: none, grid_length: 0.003, noise_std: {relative_to_strongest: 0.01}}
tolerances: {load_angle: 0, load_position: 0}
screen: {keep: 6}
place: {estimate: [s], keep: 2, instants: 1, minimum_spacing: 0.02, certificate: false}
validate:
  truth: {model: modes, parameters: {s: 1.1}, modes: 8}
  time_step: 1.0e-3
  duration: 0.2
  initial_std: {s: 0.1}
  random_sets: 0
  repeats: 1
  noise_factors: []
"""


@pytest.fixture(scope="module")
def strip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("strip")
    deck(folder / "strip.bdf")
    (folder / "strip.yaml").write_text(CONFIG)
    return folder


def test_factor_of_the_stiffness_is_found(strip):
    job = job_of(strip / "strip.yaml", strip / "results")
    found = finished(job, stages_of(job, "validate"))
    summary = found["validate"][2].summary
    assert float(summary["estimate.s"]) == pytest.approx(1.1, rel=0.01)


S = "s: {property: stiffness_factor, region: 1, guess: 1.0, range: [0.8, 1.25]}"


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))])
def test_modulus_along_the_fibres_is_found(strip, seed):
    """10 % off the guess and within 3 σ, which is less than half of what was known before."""
    config = CONFIG.replace("name: strip", "name: fibres").replace("modes: 6", "modes: 3, parameter_samples: 2")
    config = config.replace(S, "e1: {property: e1, region: 1, material: 8, guess: 1.4e+11, range: [1.1e+11, 1.8e+11]}")
    config = config.replace("[s]", "[e1]").replace("{s: 1.1}", "{e1: 1.54e+11}").replace("{s: 0.1}", "{e1: 0.1}")
    (strip / "fibres.yaml").write_text(f"{config}\nseed: {seed}\n")
    job = job_of(strip / "fibres.yaml", strip / "results")
    summary = finished(job, stages_of(job, "validate"))["validate"][2].summary
    error, std = (float(summary[f"{what}.e1"]) for what in ("error", "std"))
    assert std < 0.05
    assert abs(error) < 3 * std


@pytest.mark.parametrize(
    ("old", "new", "what", "key"),
    [
        (S, "s: {property: e1, region: 1, material: carbon, guess: 1.4e+11, range: [1.0e+11, 2.0e+11]}",
         "no orthotropic material 'carbon'", "parameters.s.material"),
        (S, "s: {property: e1, region: 1, guess: 1.4e+5, range: [1.0e+5, 2.0e+5]}",
         "the deck has 1.4e\\+11", "parameters.s.guess"),
        (S, "s: {property: area_factor, region: 1, guess: 1.0, range: [0.8, 1.2]}", "not of beams", "parameters.s.property"),
        (S, "s: {property: density, region: 1, material: 8, guess: 1600, range: [1500, 1700]}",
         "a density is not of one material", "parameters.s.material"),
        ("property: stiffness_factor", "property: youngs_modulus", "no single youngs_modulus", "parameters.s.property"),
        ("guess: 1.0, range: [0.8, 1.25]", "guess: 30, range: [0.8, 40]", "is 30, the deck has 1 ", "parameters.s.guess"),
        ("strip.bdf}", "strip.bdf, materials: {m: {regions: all, youngs_modulus: 1.0e+9, poisson_ratio: .3, density: 1}}}",
         "is a laminate, whose plies", "mesh.materials.m.regions"),
    ],
)  # fmt: skip
def test_what_is_of_no_laminate_is_refused(strip, old, new, what, key):
    assert old in CONFIG
    (strip / "other.yaml").write_text(CONFIG.replace(old, new).replace("name: strip", "name: other").replace("{s: 1.1}", "{}"))
    with pytest.raises(StrainsightError, match=what) as caught:
        finished(job_of(strip / "other.yaml", strip / "results"), PLACEMENT[:1])
    assert caught.value.key == key
    assert caught.value.remedy


def test_init_asks_for_the_factor_and_lacks_no_material(tmp_path):
    found = suggestion(deck(tmp_path / "strip.bdf"))
    assert (found.several_moduli, found.lacking, found.length_unit) == (True, (), "m")
    text = template("strip.bdf", found)
    assert "property: stiffness_factor" in text
    assert "stiffness: 1.05" in text
