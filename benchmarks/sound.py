"""Is a sound record ever refused, accused or answered wrongly? `python -m benchmarks.sound [records] [study …] [--seed N]`.

Every record is simulated: parameters, phases of the loads, noise, and in every second record gains and damping are drawn. It goes
through `estimate` as a file. A table says for every study how many records ended with 0, 2 and 3, how many had no σ, and the
largest error over σ; of a load that is RMS over RMS. Below it stands every record that did not end with 0 within 4σ.
Numbers do not depend on the machine.
"""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from strainsight import api
from strainsight.errors import InconsistentRecordError, UserError
from strainsight.experiment.structure.candidates import reading_sizes
from strainsight.experiment.structure.problem import problem_of, sample_std
from strainsight.experiment.structure.start import Loading, motion_of
from strainsight.experiment.structure.structure import Structure
from strainsight.loads.histories import Tones, instant_values, tones_of
from strainsight.mesh.model import Mesh
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.rom.modal_step import hold_of_tones
from strainsight.rom.model import accelerations, modal_basis

MOST = 4.0
"""σ that an error may be."""
STEPS = 500
A_PERIOD = 40.0
"""Samples a period of the highest tone."""
SPREAD = 0.08
"""σ of the logarithm of a true parameter over its guess."""
GAIN, LOAD_GAIN, DAMPING = 0.01, 0.005, 1.2
STRUCTURES = ("beam", "plate", "frame")
UNKNOWNS: Mapping[str, tuple[str, ...]] = {
    "E": ("E",),
    "rho": ("rho",),
    "load": ("tip",),
    "two loads": ("tip", "side"),
    "load + E": ("tip", "E"),
}
STARTS = ("moving", "rest", "settled")


@dataclass(frozen=True)
class Study:
    """structure and unknowns by name; sensors: gauges, or one accelerometer; start: of the record."""

    structure: str
    unknown: str
    sensors: str
    start: str

    def __str__(self) -> str:
        return f"{self.structure}, {self.unknown}, {self.sensors}, {self.start}"

    @property
    def estimate(self) -> tuple[str, ...]:
        return UNKNOWNS[self.unknown]

    @property
    def known(self) -> tuple[str, ...]:
        return tuple(name for name in ("tip", "side") if name not in self.estimate)


def studies() -> list[Study]:
    """All that make sense: a settled motion has no unknown load, and one accelerometer does not tell a load from its drift."""
    found = []
    for start in STARTS:
        for unknown, names in UNKNOWNS.items():
            for structure in STRUCTURES:
                loads = "tip" in names
                if loads and start == "settled":
                    continue
                found.append(Study(structure, unknown, "gauges", start))
                if not loads:
                    found.append(Study(structure, unknown, "accelerometer", start))
    return found


def strips(
    corners: Sequence[tuple[float, float]], width: float, along: int, across: int
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and quadrangles (e, 4) of strips over a line through corners (x, z), `along` elements between two."""
    line = [np.linspace(a, b, along, endpoint=False) for a, b in pairwise(corners)]
    path = np.vstack([*line, corners[-1:]])
    y = np.linspace(0, width, across + 1)
    points = np.array([(x, v, z) for x, z in path for v in y])
    number = np.arange(len(points)).reshape(len(path), across + 1)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    return points, quads.reshape(-1, 4)


def deck(structure: str) -> tuple[str, int, int]:
    """Nastran, and the nodes that the loads tip and side act on."""
    if structure == "frame":
        points, quads = strips([(0, 0), (0, 0.5), (0.6, 0.5), (0.6, 0)], 0.06, 6, 1)
        held, thick = np.flatnonzero(points[:, 2] == 0), 0.006
        tip, side = 2 * 9, 2 * 5
    elif structure == "plate":
        points, quads = strips([(0, 0), (0.5, 0)], 0.4, 8, 6)
        held, thick = np.flatnonzero(points[:, 0] == 0), 0.004
        tip, side = len(points) - 2, 7 * 5
    else:
        points, quads = strips([(0, 0), (0.8, 0)], 0.05, 16, 2)
        held, thick = np.flatnonzero(points[:, 0] == 0), 0.006
        tip, side = len(points) - 2, 3 * 9 + 1
    lines = [f"GRID,{i},,{x:.9g},{y:.9g},{z:.9g}" for i, (x, y, z) in enumerate(points, 1)]
    lines += [f"CQUAD4,{e},1,{','.join(str(n + 1) for n in own)}" for e, own in enumerate(quads, 1)]
    lines += [f"PSHELL,1,1,{thick},1,,1", "MAT1,1,2.0E11,,0.3,7850.0"]
    lines += [f"SPC1,1,123456,{n + 1}" for n in held]
    text = "\n".join(["SOL 103", "CEND", "SPC = 1", "BEGIN BULK", *lines, "ENDDATA", ""])
    return text, tip + 1, side + 1


def config_of(study: Study, frequency: tuple[float, float], h: float) -> dict[str, object]:
    """frequency [Hz]: lowest and highest of the loads; h [s]."""
    _, tip, side = deck(study.structure)
    low, high = frequency
    signal = {"type": "multisine", "lowest": low, "highest": high, "count": 4, "amplitude": 10.0}
    along = [0, 0, 1] if study.structure != "frame" else [1, 0, 1]
    loads = {
        name: {"node": node, "direction": along, "known": name in study.known, "signal": signal | {"seed": i}}
        for i, (name, node) in enumerate((("tip", tip), ("side", side)))
    }
    every = {
        "E": {"property": "youngs_modulus", "region": 1, "guess": 2.0e11, "range": [1.4e11, 2.9e11]},
        "rho": {"property": "density", "region": 1, "guess": 7850.0, "range": [5500.0, 11000.0]},
    }
    parameters = {name: own for name, own in every.items() if name in study.estimate} or {"E": every["E"]}
    return {
        "kind": "placement",
        "name": "sound",
        "mesh": {"file": f"{study.structure}.bdf", "length_unit": "m", "mass_unit": "kg"},
        "parameters": parameters,
        "loads": loads,
        "damping": {"type": "modal", "ratio": 0.01},
        "rom": {"modes": 8},
        "train": {"duration": STEPS * h, "time_step": h},
        "gauges": {
            "surface": "all",
            "direction": {"type": "axis", "axis": [1, 0, 1], "angles": [0]},
            "clearance": "none",
            "noise_std": {"relative_to_strongest": 0.01},
        },
        "motion_sensors": {
            "acc": {"quantity": "acceleration", "axes": [along], "noise_std": {"relative_to_strongest": 0.01}}
        },
        "screen": {"keep": 400, "minimum_spacing": 0},
        "place": {"estimate": list(study.estimate), "keep": 4},
        "validate": {
            "time_step": h,
            "duration": STEPS * h,
            "initial_std": {name: 0.1 if name in every else 1.0 for name in study.estimate},
        },
        "filter": {"compare": False},
    }


@dataclass(frozen=True)
class Prepared:
    """What records of a study share; low, high [Hz] of its loads, h [s]."""

    mesh: Mesh
    reduced: Reduced
    training: Training
    screened: Screened
    h: float
    file: Path


@cache
def prepared(folder: Path, study: Study) -> Prepared:
    """Of studies that differ in sensors and start alone it is the same."""
    (folder / f"{study.structure}.bdf").write_text(deck(study.structure)[0])
    file = folder / f"{study.structure}-{study.unknown.replace(' ', '')}.yaml"
    h, band = 1e-3, (5.0, 20.0)
    for _ in range(2):  # the band of the loads by the modes
        file.write_text(json.dumps(config_of(study, band, h)))
        case = api.load(file)
        mesh = api.mesh(case)
        reduced = api.reduce(case, mesh)
        f = np.sqrt(modal_basis(reduced.model, reduced.model.reference)[0]) / (2 * np.pi)
        high = 1.3 * float(f[1])
        band = round(max(0.6 * float(f[0]), high / 6), 3), round(high, 3)
        h = float(f"{1 / (A_PERIOD * band[1]):.3g}")
    file.write_text(json.dumps(config_of(study, band, h)))
    case = api.load(file)
    training = api.train(case, mesh, reduced)
    return Prepared(mesh, reduced, training, api.screen(case, mesh, reduced, training), h, file)


def record(folder: Path, study: Study, number: int) -> tuple[str, float]:
    """How a record ended, and its largest error over σ."""
    own = prepared(folder, replace(study, sensors="gauges", start="moving"))
    rng, tolerant = np.random.default_rng([11, number]), number % 2 == 0
    exact = "{position: 0, angle: 0, transverse: 0, common_gain: 0, load_angle: 0, load_position: 0, load_mass: 0, frequency: 0, "
    tolerances = exact + f"gain: {GAIN}, load_gain: {LOAD_GAIN}, damping: {DAMPING}}}" if tolerant else "none"
    case = api.load(own.file, [f"tolerances={tolerances}"])
    structure = Structure(case.config, case.files, own.mesh, own.reduced, own.training)
    problem = problem_of(structure, own.screened)
    kind = int(study.sensors == "accelerometer")
    gauges = layout(own, kind, 1 if kind else 4, rng)
    channels = problem.channels.of(gauges).ravel()
    model = own.reduced.model
    theta = {
        name: float(v * np.exp(SPREAD * np.clip(rng.standard_normal(), -2, 2))) for name, v in model.reference.items()
    }
    theta |= {name: model.reference[name] for name in model.reference if name not in study.estimate}
    factors = np.exp(np.log(DAMPING) * rng.standard_normal(model.size)) if tolerant else np.ones(model.size)
    true_model = replace(model, damping=model.damping.scaled(tuple(factors)))
    tones = tones_of([problem.run.signals[name] for name in model.inputs])
    assert tones is not None
    turned = np.exp(2j * np.pi * rng.random(tones.amplitude.shape)) * np.exp(0.2 * rng.standard_normal())
    tones = Tones(tones.frequency, tones.amplitude * turned)
    z = np.exp(1j * tones.frequency * own.h * np.arange(STEPS)[:, None])
    held = np.einsum("tk,kj,kn->tjn", z, hold_of_tones(tones.frequency, own.h), tones.amplitude).real
    lead = np.zeros((0, *held.shape[1:]))
    loading = Loading(held, own.h, None if study.start == "rest" else tones, lead)
    x, u = motion_of(true_model, theta, loading), instant_values(held)
    moving = accelerations(true_model, theta, x, u) if kind else x[:, : true_model.size]
    y = moving @ problem.channels.rows[channels].T
    std = sample_std(problem, channels, own.h)
    gain, load_gain = (1 + tolerant * s * rng.standard_normal(n) for s, n in ((GAIN, len(channels)), (LOAD_GAIN, 2)))
    y = y * gain + std * rng.standard_normal(y.shape)
    known = [model.inputs.index(name) for name in study.known]
    columns = [own.h * np.arange(STEPS + 1), *y.T, *(u * load_gain)[:, known].T]
    units = ["m/s2" if kind else "m/m"] * len(channels)
    names = [f"G{i + 1}" for i in range(len(channels))]
    heads = ["time [s]", *(f"{n} [{v}]" for n, v in zip(names, units, strict=True)), *(f"{n} [N]" for n in study.known)]
    file = folder / "record.csv"
    np.savetxt(file, np.column_stack(columns), "%.12g", ",", header=",".join(heads), comments="")
    entries = ", ".join(f"{{channel: {n}, gauge: {n}, unit: {v}}}" for n, v in zip(names, units, strict=True))
    inputs = ", ".join(f"{n}: {{channel: {n}, unit: N}}" for n in study.known)
    settings = f"{{file: record.csv, as_placed: true, start: {study.start}, time: {{channel: time}}, "
    settings += f"channels: [{entries}], inputs: {{{inputs}}}}}"
    case = api.load(own.file, [f"tolerances={tolerances}", f"estimate={settings}"])
    try:
        found = api.estimate(case, own.mesh, own.reduced, own.training, own.screened, gauges)
    except InconsistentRecordError as error:
        return f"3: {error.what}", np.nan
    except UserError as error:
        return f"2: {error.what}", np.nan
    if not found.judgement.trusted:
        return f"3: {found.judgement.words}", np.nan
    if found.decision.withheld:
        return f"withheld: {found.decision.withheld}", np.nan
    ratio = []
    for name in study.estimate:
        mean, sigma = found.estimated.smoothed[name], found.estimated.smoothed_std[name]
        if name in theta:
            ratio.append(abs(mean[-1] - theta[name]) / sigma[-1])
        else:
            late, true = slice(STEPS // 10, None), u[:, model.inputs.index(name)]
            ratio.append(np.sqrt(np.mean((mean - true)[late] ** 2) / np.mean(sigma[late] ** 2)))
    return "0", float(max(ratio))


def layout(own: Prepared, kind: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """Gauges (count,) drawn from those that read a third of the strongest of their kind, as far apart as 20 draws get."""
    pool, motion = own.training.candidates, own.training.motions[0]
    x = np.hstack([motion.coordinate, motion.velocity])
    rms, _ = reading_sizes(own.reduced.model, own.training.rows, pool.quantity, x, motion.load)
    strong = np.flatnonzero((pool.quantity == kind) & (rms > rms[pool.quantity == kind].max() / 3))
    strong = strong[np.isin(pool.gauge[strong], own.screened.kept)]
    best, far = strong[:count], -1.0
    for _ in range(20):
        drawn = rng.choice(strong, count, replace=False)
        apart = np.linalg.norm(pool.position[drawn][:, None] - pool.position[drawn], axis=-1) + 1e9 * np.eye(count)
        best, far = (drawn, apart.min()) if apart.min() > far else (best, far)
    return np.asarray(pool.gauge[best])


def main(words: Sequence[str]) -> None:
    every = {str(own): own for own in studies()}
    parser = ArgumentParser(description="Whether estimate accuses, refuses or misjudges sound records.")
    parser.add_argument("records", type=int, nargs="?", default=300, help="in turn of every study")
    parser.add_argument("studies", nargs="*", help="words that the name of a study holds; all where there are none")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, help="number of one record, drawn as in a run of all")
    given = parser.parse_args(words)
    chosen = list(every.values())
    found: dict[Study, list[tuple[str, float]]] = defaultdict(list)
    wrong = []
    with TemporaryDirectory() as folder:
        for i in range(given.records) if given.only is None else [given.only]:
            study, number = chosen[i % len(chosen)], 10_000 * given.seed + i // len(chosen) * 7 + i
            if not all(word in str(study) for word in given.studies):
                continue
            end, ratio = record(Path(folder), study, number)
            found[study].append((end, ratio))
            print(f"{i + 1}: {study}: {end[:40]}, {ratio:.2f}σ", file=sys.stderr, flush=True)
            if end != "0" or ratio > MOST:
                wrong.append(f"{i}, {study}: {end}, {ratio:.2f}σ")
    print("| study | records | 0 | 2 | 3 | no σ | largest error/σ |\n|---|---|---|---|---|---|---|")
    for study, ends in found.items():
        counts = [sum(end.startswith(code) for end, _ in ends) for code in ("0", "2", "3", "withheld")]
        sizes = [size for _, size in ends if np.isfinite(size)]
        print(f"| {study} | {len(ends)} | {' | '.join(map(str, counts))} | {max(sizes, default=np.nan):.2f} |")
    print(f"\n{sum(map(len, found.values()))} records, {len(wrong)} of them wrong\n")
    print("\n".join(wrong))


if __name__ == "__main__":
    main(sys.argv[1:])
