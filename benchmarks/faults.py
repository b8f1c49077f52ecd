"""Which faults of channels does `estimate` name rightly? `python -m benchmarks.faults [records] [case …] [--seed N]`.

Every record has a truth `perturbed` (installation of the gauges, gains, loads and damping drawn from the tolerances), other
noise, and one fault of one channel drawn from the list, or none. A table says how many were named rightly, were among several
candidates, were named wrongly, were seen without a name, and were not seen. Numbers do not depend on the machine.
The parts of `parts.py` have other faults: `"yoke, load"`, `"portal, E"` and so on.
`--rest SECONDS`: nothing moves for so long before the loads begin, from rest; gauges are as wrong then as later.
`--seed N`: records 1000 N + 1 and on, of which truth, noise, channel and size are drawn anew. Thresholds were chosen by the
records of seed 0; those of others say how far they hold where they were not.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
from benchmarks.parts import PARTS, write_part

from strainsight import api
from strainsight.config.estimate import Estimate
from strainsight.estimation.fault_evidence import CheckRecord
from strainsight.estimation.fault_search import Diagnosis
from strainsight.estimation.faults import Fault
from strainsight.estimation.record_check import check_record
from strainsight.experiment.structure import truth as drawn_installations
from strainsight.experiment.structure import truth as truths
from strainsight.experiment.structure.considered import Tolerated, tolerated
from strainsight.experiment.structure.consistency import Turning, build_check_record, turning_of
from strainsight.experiment.structure.measured import Measured, RecordSettings
from strainsight.experiment.structure.problem import filter_model, problem_of, sample_std
from strainsight.experiment.structure.record_filter import RecordFilter
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.trial import Trial, sample_noise, trial_of
from strainsight.sensors.installation import Installation

ROOT = Path(__file__).resolve().parent.parent
NOISE = 0.01
"""Of the strongest candidate."""
CASES = {
    "cantilever, load": ("cantilever-input.yaml", ("parameters.E.guess=2.1e+11", "validate.duration=0.25")),
    "hub, E": ("hub/hub-youngs-modulus.yaml", ("validate.duration=0.5",)),
    "lug, three loads": ("lug/lug-input.yaml", ()),
    "hub, three loads": ("hub/hub-input.yaml", ("validate.duration=2.0",)),
    "lug, three loads, three gauges": ("lug/lug-input.yaml", ("place.keep=3",)),
}
STUDIED = tuple(CASES)[:3]
"""Cases with more gauges than unknowns."""
OF_PARTS = {f"{part}, {unknown}": (part, unknown) for part in PARTS for unknown in ("load", "E")}
"""Parts of `benchmarks.parts`, with five gauges, default tolerances and 1 µm/m noise."""
FAULTS = (
    "sign",
    "× 0.5",
    "× 2",
    "× 0.001",
    "× 1000",
    "× 1e-06",
    "× 1e+06",
    "swapped",
    "offset",
    "drift",
    "dead",
    "clipped",
    "late",
    "45°",
    "90°",
    "late",
    "swapped",
    "offset",
    "sign",
    "drift",
    "15°",
    "30°",
)
"""Every one, and those with a size or a partner of their own twice."""
PART_FAULTS = ("× 1.25", "sign", "swapped", "dead", "spikes", "stuck", "zero")
"""Faults of the parts. zero: the channel reads exactly 0."""
UNLIKE = 0.1
"""RMS of the difference of two channels over that of one, from which a swap of them is drawn; where none are so unlike, of the
pair that is most."""


@dataclass(frozen=True)
class Study:
    """A case with its layout; reading: realisation, channel and degrees that its gauge is turned by → (T + 1, m) without
    noise; rest: samples before the loads begin, in which nothing moves."""

    structure: Structure
    tolerances: Tolerated
    trial: Trial
    turning: Turning
    reading: Callable[[int, int, float], np.ndarray]
    rest: int = 0

    @property
    def noise(self) -> np.ndarray:
        """σ (m,) of a sample."""
        return sample_std(self.trial.problem, self.trial.chosen, self.trial.h)


def study_of(name: str, noise: float = NOISE, more: Sequence[str] = (), rest: float = 0.0) -> Study:
    if name in OF_PARTS:
        with TemporaryDirectory() as folder:
            return _study(write_part(Path(folder), *OF_PARTS[name]), [], rest)
    file, settings = CASES[name]
    stated = [f"gauges.noise_std={{relative_to_strongest: {noise}}}", "validate.truth.model=perturbed", *settings, *more]
    return _study(ROOT / "configs" / file, stated, rest)


def _study(file: Path, settings: Sequence[str], rest: float) -> Study:
    # a motion that is periodic from the first instant on has no rest before it
    case = api.load(file, [*settings, *(["train.settle=none"] if rest else [])])
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, mesh, reduced, training)
    gauges = api.place(case, mesh, reduced, training, screened).gauges
    structure = Structure(case.config, case.files, mesh, reduced, training)
    problem = problem_of(structure, screened)
    truth = truths.truth_of(structure, None, problem, case)
    tolerances = tolerated(structure, problem.channels.of(gauges))
    trial = trial_of(case.config, problem, truth, tolerances, gauges)
    again, drawn = trial.again, drawn_installations.installation_of
    assert again is not None

    def reading(realisation: int, channel: int, degrees: float) -> np.ndarray:
        gauge = training.candidates.gauge[trial.chosen[channel]]

        def turned(*given: object) -> Installation:
            own = drawn(*given)  # type: ignore[arg-type]
            angle = own.angle.copy()
            angle[gauge] += np.deg2rad(degrees)
            return replace(own, angle=angle)

        with patch.object(truths, "installation_of", turned):
            return again(realisation)

    turning = turning_of(structure, trial.chosen)
    count = round(rest / trial.h)
    return Study(structure, tolerances, trial, turning, reading, count)


def suspect(study: Study, samples: np.ndarray) -> CheckRecord:
    trial = study.trial
    model, m = filter_model(trial.problem, trial.chosen, trial.h), len(trial.chosen)
    settings = RecordSettings("", "", Estimate.model_construct(), *("estimate",) * 4)
    nothing = np.full(m, np.nan), np.zeros(m), (), settings
    known = np.concatenate([np.zeros((study.rest, *trial.known.shape[1:])), trial.known])
    time = trial.h * np.arange(len(samples) + 1)
    test = Measured(time, trial.h, 1, known, samples, trial.chosen, ("",) * m, *nothing)
    given = RecordFilter(trial.problem, study.tolerances, model, test, trial.covariance, trial.settled)
    return build_check_record(study.structure, given, study.turning)


def record(study: Study, realisation: int, channel: int = 0, degrees: float = 0.0) -> np.ndarray:
    """Samples (T, m) of a sound record, or of one with a gauge turned."""
    reading = study.reading(realisation, channel, degrees)[1:]
    reading = np.concatenate([np.zeros((study.rest, reading.shape[1])), reading])
    return reading + sample_noise(7, realisation, *reading.shape) * study.noise


def with_fault(study: Study, what: str, realisation: int) -> tuple[np.ndarray, Fault]:
    """A record with a fault: its channel, size and partner drawn."""
    m, rng = len(study.trial.chosen), np.random.default_rng([3, realisation])
    j = int(rng.integers(m))
    if what.endswith("°"):
        angle = float(what[:-1])
        return record(study, realisation, j, angle), Fault("angle", j, angle)
    y = record(study, realisation)
    rms, T, way = float(np.sqrt(np.mean(y[study.rest :, j] ** 2))), len(y), float(rng.choice([-1.0, 1.0]))
    if what == "sign":
        y[:, j] *= -1
        return y, Fault("sign", j)
    if what == "offset":
        y[:, j] += way * rng.uniform(0.2, 2.0) * rms
        return y, Fault("offset", j)
    if what == "drift":
        y[:, j] += way * rng.uniform(0.3, 3.0) * rms * np.arange(1, T + 1) / T
        return y, Fault("drift", j)
    if what == "dead":
        y[:, j] = study.noise[j] * rng.standard_normal(T)
        return y, Fault("dead", j)
    if what == "zero":
        y[:, j] = 0.0
        return y, Fault("dead", j)
    if what == "spikes":
        at = rng.choice(T, int(rng.integers(1, 6)), replace=False)
        y[at, j] += rng.choice([-1.0, 1.0], len(at)) * rng.uniform(1, 10, len(at)) * np.abs(y[:, j]).max()
        return y, Fault("spikes", j)
    if what == "stuck":
        first = int(rng.uniform(0.2, 0.7) * T)
        y[first:, j] = y[first, j]
        return y, Fault("stuck", j)
    if what == "clipped":
        limit = rng.uniform(0.5, 0.8) * np.abs(y[:, j]).max()
        y[:, j] = np.clip(y[:, j], -limit, limit)
        return y, Fault("clipped", j)
    if what == "late":
        n = int(rng.integers(2, 10))
        y[n:, j] = y[:-n, j].copy()
        return y, Fault("late", j, n)
    if what == "swapped":
        pairs = [(i, k) for i in range(m) for k in range(i + 1, m)]
        moving = y[study.rest :]
        apart = np.array(
            [np.sqrt(np.mean((moving[:, i] - moving[:, k]) ** 2) / np.mean(moving[:, i] ** 2)) for i, k in pairs]
        )
        unlike = np.flatnonzero(apart >= min(UNLIKE, apart.max()))
        i, k = pairs[unlike[int(rng.integers(len(unlike)))]]
        y[:, [i, k]] = y[:, [k, i]]
        return y, Fault("swapped", i, k)
    factor = float(what[2:])
    y[:, j] *= factor
    return y, Fault("scale", j, factor)


def same_fault(named: Fault, fault: Fault) -> bool:
    """Whether a named fault is the one of the record: an angle with either sign, a factor within 15 %, which contains errors
    of the installation."""
    if fault.kind == "scale":
        return named.family[:2] == fault.family[:2] and abs(np.log(named.amount / fault.amount)) < 0.15
    return named.family == fault.family and (fault.kind != "late" or named.amount == fault.amount)


def outcome(found: Diagnosis, fault: Fault | None) -> str:
    """What was made of a record that has this fault."""
    if not found.inconsistent:
        return "not seen"
    if fault is None:
        return "accused"
    named = found.named
    if named is not None and named.fault is not None:
        alone = "angle alone" if named.fault.kind == "angle" else "wrong"
        return "named" if same_fault(named.fault, fault) else alone
    if any(one.fault is not None and same_fault(one.fault, fault) for one in found.candidates):
        return "among candidates"
    return "other candidates" if found.candidates else "no name"


def main(words: Sequence[str]) -> None:
    parser = ArgumentParser(description="Which faults of channels estimate names rightly.")
    parser.add_argument("records", type=int, nargs="?", default=len(FAULTS))
    parser.add_argument("cases", nargs="*", default=STUDIED, choices=[*CASES, *OF_PARTS, STUDIED])
    parser.add_argument("--seed", type=int, default=0, help="0: the records by which thresholds were chosen")
    parser.add_argument("--rest", type=float, default=0.0, help="seconds in which nothing moves before the loads begin")
    parser.add_argument("--sound", type=int, help="sound records of a case; as many as records with faults")
    given = parser.parse_args(words)
    count = given.records if given.sound is None else given.sound
    first = 1000 * given.seed
    print("| case | fault | named | outcome |\n|---|---|---|---|")
    for name in given.cases:
        study, counts = study_of(name, rest=given.rest), Counter[str]()
        faults = PART_FAULTS if name in OF_PARTS else FAULTS
        discrepancy = study.tolerances.discrepancy
        for r in range(given.records):
            samples, fault = with_fault(study, faults[r % len(faults)], first + r + 1)
            found = check_record(suspect(study, samples), discrepancy).finding
            named = found.named
            said = outcome(found, fault)
            counts[said] += 1
            print(f"| {name} | {fault} | {named and named.fault} | {said} |", flush=True)
        sound = Counter(
            outcome(check_record(suspect(study, record(study, first + 100 + r)), discrepancy).finding, None)
            for r in range(count)
        )
        print(
            f"\n{name}: {given.records} faults: {dict(counts)}; {count} sound records: {dict(sound)}\n",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
