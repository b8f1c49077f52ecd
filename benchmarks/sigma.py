"""Does σ hold where gauges are not where they are meant to be? `python -m benchmarks.sigma [draws] [case …] [--key=value …]`.

Every draw has a truth `perturbed`: installation of the gauges, gains and damping drawn from the tolerances, and other
noise. A table says, for every unknown, how often the truth lies within 2σ, and the RMS of error over that of σ. Draws of one
case share the layout and the true parameters. Numbers are errors, not times: they do not depend on the machine.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from multiprocessing import Pool
from pathlib import Path

import numpy as np

from strainsight import api
from strainsight.experiment.structure.considered import tolerated
from strainsight.experiment.structure.problem import filter_model, problem_of, sample_std
from strainsight.experiment.structure.start import Loading
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.trial import Trial, sample_noise, trial_of
from strainsight.experiment.structure.truth import SimulatedMotion, truth_of
from strainsight.mesh.model import Mesh
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training

ROOT = Path(__file__).resolve().parent.parent
NOISES = (0.001, 0.01, 0.05)
"""Of the strongest candidate."""
KNOWN_MODULUS = "parameters.E.guess=2.1e+11"
"""In place of the estimate of another run, where the loads alone are unknown."""
CASES = {
    "cantilever E": "cantilever-youngs-modulus.yaml",
    "cantilever ρ": "cantilever-density.yaml",
    "cantilever ρ, 35 Hz": "cantilever-density-35hz.yaml",
    "cantilever load": "cantilever-input.yaml",
    "hub E": "hub/hub-youngs-modulus.yaml",
    "hub ρ": "hub/hub-density.yaml",
    "hub three loads": "hub/hub-input.yaml",
    "hub E + ρ": "hub/hub-youngs-modulus-density.yaml",
    "hub two loads + E, shaker": "hub/hub-input-youngs-modulus-better.yaml",
    "lug E": "lug/lug-youngs-modulus.yaml",
    "lug three loads": "lug/lug-input.yaml",
    "lug three loads + E": "lug/lug-input-youngs-modulus.yaml",
}


@dataclass(frozen=True)
class Drawn:
    """Of every unknown, one draw: error and σ, of a load RMS after the first tenth, in one unit; share of it within 2σ."""

    error: np.ndarray
    std: np.ndarray
    inside: np.ndarray


@cache
def before_screening(config: str, settings: tuple[str, ...]) -> tuple[Mesh, Reduced, Training]:
    """What the noise of the gauges does not change."""
    case = loaded(config, NOISES[0], settings)
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    return mesh, reduced, api.train(case, mesh, reduced)


def loaded(config: str, noise: float, settings: tuple[str, ...]) -> api.Case:
    stated = [f"gauges.noise_std={{relative_to_strongest: {noise}}}", "validate.truth.model=perturbed", *settings]
    if config == CASES["cantilever load"]:
        stated.append(KNOWN_MODULUS)
    return api.load(ROOT / "configs" / config, stated)


def trial_at(config: str, noise: float, settings: tuple[str, ...] = ()) -> Trial:
    """The layout of a config at one noise of its gauges, and its truth."""
    case, (mesh, reduced, training) = loaded(config, noise, settings), before_screening(config, settings)
    screened = api.screen(case, mesh, reduced, training)
    gauges = api.place(case, mesh, reduced, training, screened).gauges
    structure = Structure(case.config, case.files, mesh, reduced, training)
    problem = problem_of(structure, screened)
    truth = truth_of(structure, None, problem, case)
    channels = problem.channels.of(gauges)
    return trial_of(case.config, problem, truth, tolerated(structure, channels), gauges)


def drawn(trial: Trial, reading: np.ndarray, realisation: int) -> Drawn:
    """Filter one draw: reading (T + 1, k) of its truth without noise."""
    model = filter_model(trial.problem, trial.chosen, trial.h)
    noise = sample_noise(1, realisation, len(reading) - 1, reading.shape[1])
    measured = reading[1:] + noise * sample_std(trial.problem, trial.chosen, trial.h)
    run = trial.filtered(model, trial.chosen, measured).run
    unknowns, late = trial.problem.unknowns, slice(len(trial.time) // 10, None)
    found = []
    for name, at in zip(unknowns.names, model.position, strict=True):
        mean, std = run.mean[:, 0, at], run.std[:, 0, at]
        if name in unknowns.parameters:
            error, std = mean[-1:] - np.log(trial.history[name][0] / unknowns.guess[name]), std[-1:]
        else:
            error, std = (mean - trial.history[name] / unknowns.amplitude[name])[late], std[late]
        found.append((np.sqrt(np.mean(error**2)), np.sqrt(np.mean(std**2)), np.mean(np.abs(error) < 2 * std)))
    return Drawn(*np.array(found).T)


def one(trial: Trial, part: tuple[np.ndarray, int]) -> Drawn:
    return drawn(trial, *part)


def table(case: str, noise: float, draws: int, settings: tuple[str, ...], pool: object) -> list[str]:
    """Lines of the table for one case at one noise."""
    trial = trial_at(CASES[case], noise, settings)
    assert trial.again is not None
    readings = [(trial.again(r), r) for r in range(1, draws + 1)]
    light = replace(trial, truth=replace(trial.truth, motion=none, again=None), again=None)
    found = pool.map(partial(one, light), readings, chunksize=4)  # type: ignore[attr-defined]
    lines = []
    for i, name in enumerate(trial.names):
        error, std = (np.array([getattr(own, key)[i] for own in found]) for key in ("error", "std"))
        inside = float(np.mean([own.inside[i] for own in found]))
        ratio = float(np.sqrt(np.mean(error**2) / np.mean(std**2)))
        rms, claimed = (100 * np.sqrt(np.mean(own**2)) for own in (error, std))
        lines.append(
            f"| {case} | {100 * noise:g} % | {name} | {rms:.3g} % | {claimed:.3g} % | {ratio:.2f} | {100 * inside:.1f} % |"
        )
    return lines


def none(_: Loading) -> SimulatedMotion:
    raise AssertionError("the truth stays in the process that simulated it")


def main(words: Sequence[str]) -> None:
    settings = tuple(word[2:] for word in words if word.startswith("--"))
    words = [word for word in words if not word.startswith("--")]
    draws = int(words[0]) if words else 400
    cases = words[1:] or list(CASES)
    print("| case | noise | unknown | RMS error | RMS σ | ratio | within 2σ |\n|---|---|---|---|---|---|---|")
    with Pool(2) as pool:
        for case in cases:
            for noise in NOISES:
                print("\n".join(table(case, noise, draws, settings, pool)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
