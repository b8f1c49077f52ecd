"""A composite wing of 20 160 quadrangles from its deck to its page: `python -m benchmarks.composite_wing [--elements C S H] …`.

Three unknown loads at the tip, E1 of all plies free, a known shaker at half span; eight gauges, none in the last bay, where
loads enter. Every stage by the command line in a process of its own: processor seconds, those on the clock, peak memory.
Each has 1 to 2 s of start-up that `strainsight run` has once. --lean: validation without its studies. --whole: all by
`strainsight run` in one process, in place of that.

--ccx PROGRAM: then a record of its own, in time by modes of CalculiX on another mesh of quadratic shells with E1 5 % lower, goes
through `strainsight estimate`, each of --seeds with other loads and noise: errors and σ of every unknown
(tests/stages/wing_record.py). --diagonal: candidates at ±45° from the principal directions, too.
"""

from __future__ import annotations

import argparse
import csv
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from benchmarks.scaling import STAGES, spent
from benchmarks.wing_by_calculix import RECORD as MADE
from benchmarks.wing_by_calculix import responses

from strainsight.runner.artefact import Artefact

ROOT = Path(__file__).resolve().parent.parent
ELEMENTS = (42, 168, 9)
NOISE, E1 = 1e-6, 1.235e11
CONFIG = (
    """
kind: placement
name: wing
seed: 1
"""
    + MADE.CASE
    + """\
train: {duration: 1.0, time_step: 2.0e-3}
gauges:
  type: 6/350
  direction: {type: principal, angles: [0]}
  exclude:
    - shell_face: lower
    - on_elements: beams
    - box: [[-1, 2.6, -1], [2, 3.1, 1]]
  noise_std: {value: 1.0e-6}
screen: {keep: 80}
place: {estimate: [lift, drag, twist, E1], keep: 8, instants: 1, certificate: false}
validate:
  truth: {model: perturbed, modes: 20, parameters: {E1: 1.235e+11}}
  time_step: 2.0e-3
  duration: 1.0
  initial_std: {lift: 1.0, drag: 1.0, twist: 1.0, E1: 0.1}
filter: {compare: false}
"""
)
LEAN = ("--set", "validate.random_sets=0", "--set", "validate.noise_factors=[]", "--set", "validate.repeats=1")
ESTIMATE = """estimate:
  file: record.csv
  time: {{channel: time}}
  start: rest
  as_placed: true
  channels:
{channels}
  inputs: {{shaker: {{channel: shaker, unit: N}}}}
"""


def one_stage(folder: Path, words: Sequence[str]) -> Mapping[str, float]:
    """A stage by the command line; ends the benchmark where it fails."""
    code = "from strainsight_cli.main import main; main()"
    done = spent(
        ("-c", code, *words[:1], str(folder / "wing.yaml"), "--results", str(folder / "results"), *words[1:]), None
    )
    if done["code"]:
        raise SystemExit(f"{words[0]}: exit code {done['code']}\n{done['errors']}")
    return done


def timed(folder: Path, lean: bool, until: str) -> None:
    print(f"{'stage':10s} {'processor s':>12s} {'clock s':>8s} {'peak GiB':>9s}   load")
    total = np.zeros(2)
    for stage in STAGES[: STAGES.index(until) + 1]:
        own = one_stage(folder, (stage, *(LEAN if lean else ())))
        total += own["seconds"], own["clock"]
        print(
            f"{stage:10s} {own['seconds']:12.1f} {own['clock']:8.1f} {own['peak']:9.2f}   {os.getloadavg()[0]:.1f}",
            flush=True,
        )
    print(f"{'sum':10s} {total[0]:12.1f} {total[1]:8.1f}")


def whole(folder: Path, lean: bool) -> None:
    """As a user does it."""
    own = one_stage(folder, ("run", *(LEAN if lean else ())))
    print(
        f"run: {own['seconds']:.1f} s of processor, {own['clock']:.1f} s on the clock; load {os.getloadavg()[0]:.1f}",
        flush=True,
    )


def estimated(folder: Path, config: str, ccx: str, seeds: int) -> None:
    """Records of CalculiX through `estimate`: errors RMS over the record and σ, over the RMS of a load."""
    with (folder / "results" / "wing" / "gauges.csv").open() as file:
        rows = list(csv.DictReader(file))
    vectors = [[np.array([float(row[f"{name}_{axis}"]) for axis in "xyz"]) for name in PLACE] for row in rows]
    places = [MADE.Place(int(row["element"]), 1e3 * x, n, d) for row, (x, n, d) in zip(rows, vectors, strict=True)]
    own = responses(places, ccx)
    channels = "\n".join(f"    - {{channel: {row['gauge']}, gauge: {row['gauge']}, unit: um/m}}" for row in rows)
    (folder / "wing.yaml").write_text(config + ESTIMATE.format(channels=channels))
    for seed in range(1, seeds + 1):
        histories = MADE.loads(seed)
        strain = MADE.record(own, histories)
        strain += NOISE * np.random.default_rng(100 + seed).standard_normal(strain.shape)
        columns = {"time": np.arange(len(strain)) / MADE.RATE, "shaker": histories["shaker"]}
        columns |= {row["gauge"]: 1e6 * one for row, one in zip(rows, strain.T, strict=True)}
        table = np.column_stack(list(columns.values()))
        np.savetxt(folder / "record.csv", table, "%.9g", ",", header=",".join(columns), comments="")
        spent_on = one_stage(folder, ("estimate", "--no-page", "--accept"))
        found = Artefact(folder / "results" / "wing" / "estimate.h5")
        said = []
        for name in ("lift", "drag", "twist"):
            true = histories[name] * (1e-3 if MADE.LOADS[name][1] == "MOMENT" else 1)
            error, std = found[f"/smoothed/{name}"] - true, found[f"/smoothed_std/{name}"]
            share, scale = np.mean(np.abs(error) < 2 * std), 100 / true.std()
            said.append(
                f"{name} {scale * _rms(error):.2f} % off, σ {scale * _rms(std):.2f} %, {100 * share:.0f} % within 2σ"
            )
        value, sigma = (float(found[f"/{what}/E1"][-1]) for what in ("estimate", "std"))
        said.append(f"E1 {100 * (value / E1 - 1):.3f} % off, σ {100 * sigma / E1:.3f} %")
        print(f"seed {seed}: {'; '.join(said)}; {spent_on['seconds']:.0f} s of processor", flush=True)


PLACE = ("position", "normal", "direction")


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--elements", nargs=3, type=int, default=ELEMENTS, metavar="N", help="along chord, span and height"
    )
    parser.add_argument("--lean", action="store_true", help="validation without its studies")
    parser.add_argument("--whole", action="store_true", help="all stages by one command")
    parser.add_argument("--until", choices=STAGES, default=STAGES[-1], metavar="STAGE", help="the last stage to run")
    parser.add_argument("--ccx", metavar="PROGRAM")
    parser.add_argument(
        "--diagonal", action="store_true", help="candidates at 45 degrees to the principal directions, too"
    )
    parser.add_argument("--seeds", type=int, default=3, metavar="N")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        config = CONFIG.replace("angles: [0]", "angles: [0, 45, -45]") if chosen.diagonal else CONFIG
        (place / "wing.bdf").write_text(MADE.deck_text(tuple(chosen.elements)), encoding="ascii")
        (place / "wing.yaml").write_text(config, encoding="utf-8")
        if chosen.whole:
            whole(place, chosen.lean)
        else:
            timed(place, chosen.lean, chosen.until)
        if chosen.ccx:
            estimated(place, config, chosen.ccx, chosen.seeds)
