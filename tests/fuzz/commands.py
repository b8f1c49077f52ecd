"""python -m tests.fuzz.commands [--inputs 300] [--seed 1]: `strainsight import` on damaged files."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from random import Random

from ..robustness.processes import Launcher
from .cases import Group, companions
from .guard import SECONDS
from .seeds import write_seeds

CONFIG = """\
kind: placement
name: own
seed: 1
mesh: {file: %s, materials: {steel: {regions: all, youngs_modulus: 2.1e+11, poisson_ratio: 0.3, density: 7850.0}}}
loads:
  tip: {node: 4, direction: [0, 0, 1], known: true, signal: {type: csv, file: %s, time_column: time, value_column: F}}
damping: {type: modal, ratio: 0.01}
rom: {modes: 2, parameter_samples: 3, tolerance: 1.0e-8}
train: {duration: 0.01, time_step: 1.0e-3}
parameters:
  E: {property: youngs_modulus, region: 12, guess: 1.89e+11, range: [1.6e+11, 2.4e+11], process_noise_scale: 0.05}
gauges:
  surface: all
  direction: {type: axis, axis: [1, 0, 0], angles: [0]}
  noise_std: {relative_to_strongest: 0.01}
screen: {keep: 4, minimum_spacing: 0.0}
place: {estimate: [E], keep: 2, instants: 2}
validate: {truth: {model: perturbed, parameters: {E: 2.1e+11}}, time_step: 1.0e-3, duration: 0.01, initial_std: {E: 0.1}}
"""
NOT_HERE = (".op4", ".mtx", ".npz", ".csv", ".h5")


def command_faults(launcher: Launcher, seeds: Path, work: Path, seed: int, first: int, last: int) -> list[str]:
    """What is wrong with how the command line ends on files first … last − 1: every third a config, the others decks."""
    decks, configs = Group("deck", seeds / "deck"), Group("config", seeds / "config")
    decks.names = [name for name in decks.names if not name.endswith(NOT_HERE)]
    folder = work / "project"
    companions("deck", seeds / "deck", folder)
    (folder / "load.csv").write_text("time,F\n0,1\n1,2\n")
    (work / "meshes").mkdir()
    (folder / "case.yaml").write_text(CONFIG % ("many.bdf", "load.csv"))
    sound = _ended(launcher, folder, work / "results", False, (0,))
    found = [f"the sound deck: {sound}"] if sound else []
    before = _everything(work) - {str(folder / "case.yaml")}
    for number in range(first, last):
        if number % 3:
            case = decks.case(seed, number)
            text = (CONFIG % (case.name, "load.csv")).encode()
            (folder / case.name).write_bytes(case.content)
        else:
            case = configs.case(seed, number)
            text = case.content
        (folder / "case.yaml").write_bytes(text)
        fault = _ended(launcher, folder, work / "results", Random(number).random() < 0.3)
        (folder / "case.yaml").unlink()
        if number % 3 and case.name not in ("case.node", "case.ele"):
            (folder / case.name).unlink()
        more = sorted(_everything(work) - before)
        if fault or more:
            found.append(f"{number} ({case.origin}): {fault or f'left behind {more[:3]}'}")
            before |= set(more)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as made, Launcher(Path(made)) as launcher:
        write_seeds(Path(made) / "seeds")
        found = command_faults(launcher, Path(made) / "seeds", Path(made) / "work", asked.seed, 0, asked.inputs)
    print(f"command line: {asked.inputs} damaged files, {len(found)} faults", *found[:20], sep="\n  ")
    return 1 if found else 0


def _ended(launcher: Launcher, folder: Path, results: Path, verbose: bool, codes: tuple[int, ...] = (0, 2)) -> str:
    says = folder.parent / "says"
    words = ["import", str(folder / "case.yaml"), "--results", str(results)]
    launcher.start([*words, "-v"] if verbose else words, says)
    try:
        code = launcher.end(4 * SECONDS)
    except AssertionError as error:
        return str(error)
    with suppress(ProcessLookupError):
        os.killpg(launcher.pid, signal.SIGKILL)
    said = says.read_text("utf-8", "replace")
    if code not in codes or "internal error" in said or ("Traceback" in said and not verbose) or not said.strip():
        return f"exit code {code}: {said[-300:]}"
    signs = {sign for sign in said if not sign.isprintable() and sign not in "\n\r"}
    return f"signs {sorted(signs)} are printed: {said[:200]!r}" if signs else ""


def _everything(work: Path) -> set[str]:
    return {str(path) for path in work.rglob("*") if path.name != "says" and not path.is_relative_to(work / "results")}


if __name__ == "__main__":
    sys.exit(main())
