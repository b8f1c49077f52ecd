"""Does the interval of damage hold? `python -m benchmarks.damage [records] [case …] [--draws=N] [--key=value …]`.

Every record has a truth of its own. `own`: the filter's own model, its start, loads and parameters drawn as the filter takes
them to be, no tolerances. `perturbed`: a sine; installation of the gauges, loads and damping drawn from the tolerances. A table
says, for slopes 3 and 8 of the S-N curve, how often the interval of 95 % holds the damage of the true stress at places on
the surface, medians of damage by draws, and by the smoothed history, over the true one, and in how many records the samples
spoke for the other walk of the load, by which damage is then drawn, and in how many for neither. Numbers are no times.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import Pool
from pathlib import Path

import numpy as np
from tests.estimation.truth import draw_truth

from strainsight import api
from strainsight.config.damage import DamageSettings
from strainsight.damage import interval_of
from strainsight.estimation.conditional import ConsideredParameters
from strainsight.estimation.grid_filter import GridRun, filter_on_grid
from strainsight.estimation.grid_filter_smoother import sample_paths, smooth_on_grid
from strainsight.estimation.model import FilterModel
from strainsight.estimation.record import GridRecord, Settled
from strainsight.experiment.structure.considered import Tolerated, build_considered, tolerated
from strainsight.experiment.structure.damage import (
    Places,
    damage_at,
    damage_places,
    may_walk_otherwise,
    theta_at,
    walking,
    walks,
)
from strainsight.experiment.structure.problem import Problem, filter_model, initial_covariance, problem_of, sample_std
from strainsight.experiment.structure.references import parameters_of
from strainsight.experiment.structure.start import loading_of
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.surface import Displaced, skin_of
from strainsight.experiment.structure.tolerated_loads import field_beyond
from strainsight.experiment.structure.trial import sample_noise, trial_of
from strainsight.experiment.structure.truth import ModalMotion, truth_of

ROOT = Path(__file__).resolve().parent.parent
SLOPES = (3.0, 8.0)
PLACES = 4
KNOWN_MODULUS = "parameters.E.guess=2.1e+11"
SHORT = (
    "validate.truth.model=perturbed",
    "rom.modes=3",
    "train.time_step=1e-3",
    "train.duration=0.2",
    "validate.time_step=1e-3",
    "validate.duration=0.1",
    "screen.keep=20",
    "place.instants=5",
    "place.certificate=false",
)
"""Two periods of the load in 100 steps, by three modes and the static shape."""
SMOOTH = "loads.tip.process_noise={model: integrated_random_walk}"
LOAD, MODULUS = "cantilever-input.yaml", "cantilever-youngs-modulus.yaml"
CASES = {
    "load, own": (LOAD, (KNOWN_MODULUS, "tolerances=none")),
    "load, perturbed": (LOAD, (KNOWN_MODULUS,)),
    "smooth load, own": (LOAD, (KNOWN_MODULUS, "tolerances=none", SMOOTH)),
    "smooth load, perturbed": (LOAD, (KNOWN_MODULUS, SMOOTH)),
    "E, own": (MODULUS, ("tolerances=none", "train.settle=none")),
    "E, perturbed": (MODULUS, ()),
}
"""Config and what is changed of it; of the filter's own model those that end with `own`."""


@dataclass(frozen=True)
class Filtering:
    """What all records of a case share, otherwise: with the other walk of its one unknown load; places of the filter's model."""

    problem: Problem
    otherwise: dict[str, tuple[Problem, np.ndarray]]
    tolerances: Tolerated
    channels: np.ndarray
    covariance: np.ndarray
    known: np.ndarray
    settled: Settled | None
    h: float
    places: Places
    draws: int


@dataclass(frozen=True)
class Record:
    """reading (T, k) without noise; true damage (slopes, places); number."""

    reading: np.ndarray
    true: np.ndarray
    number: int


def settings(slope: float, draws: int = 200) -> DamageSettings:
    return DamageSettings.model_validate({"curve": {"slope": slope, "stress": 1e8}, "draws": draws})


def filtering(
    config: str, changes: Sequence[str], draws: int, records: int, own: bool
) -> tuple[Filtering, list[Record]]:
    """The layout of a config and its records."""
    case = api.load(ROOT / "configs" / config, [*SHORT, *changes])
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, mesh, reduced, training)
    gauges = api.place(case, mesh, reduced, training, screened).gauges
    structure = Structure(case.config, case.files, mesh, reduced, training)
    problem = problem_of(structure, screened)
    channels = problem.channels.of(gauges)
    channels = channels[channels >= 0]
    parameters = parameters_of(case.config.parameters, mesh, case.files)
    truth = truth_of(structure, None, problem, case)
    allowed = tolerated(structure, channels)
    trial = trial_of(case.config, problem, truth, allowed, gauges)
    field = field_beyond(allowed.loads, filter_model(problem, channels, trial.h), reduced)
    whole = Displaced(np.hstack([reduced.basis, field]), reduced.basis.shape[1])
    every = damage_places(skin_of(mesh, whole, parameters), None)["surface"]
    which = spread(every, problem)
    otherwise = {}
    for name in problem.unknowns.inputs if may_walk_otherwise(case.config, problem.unknowns.inputs) else ():
        other = problem_of(replace(structure, config=walking(case.config, name)), screened)
        std = case.config.validation.initial_std
        otherwise[name] = other, initial_covariance(other, std, problem.loading.moving)
    shared = Filtering(
        problem,
        otherwise,
        allowed,
        channels,
        trial.covariance,
        trial.known,
        trial.settled,
        trial.h,
        every.take(which),
        draws,
    )
    if own:
        return shared, [own_record(shared, number) for number in range(1, records + 1)]
    loading = loading_of(problem.run.settle, list(problem.run.signals.values()), trial.h, len(trial.known))
    again = truth.again
    assert again is not None
    true_field = again(1, gauges).field
    assert true_field is not None
    shapes = true_field()
    real = damage_places(skin_of(mesh, Displaced(shapes, shapes.shape[1]), parameters), None)["surface"]
    at = real.take(which)
    return shared, [
        rich_record(again(number, gauges).motion(loading), at, truth.theta, len(channels), number)
        for number in range(1, records + 1)
    ]


def spread(places: Places, problem: Problem) -> np.ndarray:
    """The most damaged place of the training simulation, and others down to a tenth of its equivalent range."""
    q, theta = problem.x[:, : problem.model.size], problem.model.reference
    level = damage_at(coordinates_of(places, q), q, theta, settings(5.0))[1] ** (1 / 5.0)
    wanted = level.max() * np.linspace(1.0, 0.1, PLACES)
    return np.array([int(np.argmin(np.abs(level - own))) for own in wanted])


def coordinates_of(places: Places, q: np.ndarray) -> Places:
    """By the coordinates q (T + 1, n) alone."""
    return replace(places, rows=places.rows.of_all(lambda X: X[..., : q.shape[1]]))


def true_damage(places: Places, q: np.ndarray, theta: dict[str, float]) -> np.ndarray:
    return np.stack([damage_at(places, q, theta, settings(slope))[0] for slope in SLOPES])


def rich_record(motion: object, places: Places, theta: object, channels: int, number: int) -> Record:
    assert isinstance(motion, ModalMotion)
    return Record(motion(np.arange(channels))[1:], true_damage(places, motion.q, dict(theta)), number)  # type: ignore[call-overload]


def own_record(shared: Filtering, number: int) -> Record:
    """The noise of `draw_truth` left to `one`."""
    model = filter_model(shared.problem, shared.channels, shared.h)
    x, _ = draw_truth(model, np.zeros(model.size), shared.covariance, shared.known, [number])
    theta = theta_at(model, x[-1, 0, model.parameter_states])
    reading = x[1:, 0] @ model.H.T
    q = x[:, 0, : model.model.size]
    return Record(reading, true_damage(coordinates_of(shared.places, q), q, theta), number)


GridInputs = tuple[FilterModel, np.ndarray, np.ndarray, np.ndarray, np.ndarray, ConsideredParameters]


def one(shared: Filtering, record: Record) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool, bool]:
    """Whether the interval holds the truth; damage by draws, and by the smoothed history, over it; (slopes, places) each; whether
    the samples speak for the other walk, and whether they tell neither."""

    def filtered(problem: Problem, P: np.ndarray) -> tuple[GridInputs, GridRun]:
        model = filter_model(problem, channels, shared.h)
        considered = build_considered(shared.tolerances, model, channels, behind=True)
        args = (model, np.zeros(model.size), P, shared.known, y, considered)
        return args, filter_on_grid(GridRecord(*args, settled=shared.settled))

    def other(_: tuple[GridInputs, GridRun], name: str) -> tuple[GridInputs, GridRun]:
        return filtered(*shared.otherwise[name])

    channels = shared.channels
    noise = sample_noise(1, record.number, *record.reading.shape) * sample_std(shared.problem, channels, shared.h)
    y = record.reading + noise
    stated = filtered(shared.problem, shared.covariance)
    (args, grid_run), changed, undecided = walks(
        stated, list(shared.otherwise), other, lambda walked: float(walked[1].run.log_likelihood[0])
    )
    model = args[0]
    q = slice(0, model.model.size)
    later = smooth_on_grid(GridRecord(*stated[0], settled=shared.settled), stated[1]).mean[:, 0]
    theta = theta_at(model, later[-1, stated[0][0].parameter_states])
    width = np.shape(shared.places.rows.at(theta))[-1]
    states = Displaced(np.zeros((0, width)), model.model.size).states(later)
    mean = true_damage(shared.places, later[:, states], theta)
    drawn = [
        true_damage(shared.places, own, theta_at(model, p))
        for part in sample_paths(
            GridRecord(*args, settled=shared.settled), grid_run, shared.draws, 1_000_000 + record.number, states=q
        )
        for p, own in zip(part.parameter, part.state, strict=True)
    ]
    found = interval_of(np.array(drawn))
    inside = (found.low <= record.true) & (record.true <= found.high)
    return inside, found.median / record.true, mean / record.true, bool(changed), bool(undecided)


def table(case: str, records: int, draws: int, more: Sequence[str], pool: object) -> list[str]:
    config, changes = CASES[case]
    shared, made = filtering(config, (*changes, *more), draws, records, case.endswith("own"))
    found = pool.map(partial(one, shared), made, chunksize=2)  # type: ignore[attr-defined]
    inside, median, mean, changed, undecided = (np.array(each) for each in zip(*found, strict=True))
    walk = f"{np.sum(changed)}, {np.sum(undecided)}"
    lines = []
    for i, slope in enumerate(SLOPES):
        each = ", ".join(f"{100 * share:.1f}" for share in inside[:, i].mean(axis=0))
        lines.append(
            f"| {case} | {slope:g} | {100 * inside[:, i].mean():.1f} % | {each} | {np.median(median[:, i]):.3f} | "
            f"{np.median(mean[:, i]):.3f} | {walk} |"
        )
    return lines


def main(words: Sequence[str]) -> None:
    given = [word[2:] for word in words if word.startswith("--")]
    draws = next((int(own.removeprefix("draws=")) for own in given if own.startswith("draws=")), 100)
    more = [own for own in given if not own.startswith("draws=")]
    words = [word for word in words if not word.startswith("--")]
    records, cases = int(words[0]) if words else 200, words[1:] or list(CASES)
    print(
        "| case | slope | within 95 % | each place | draws over truth | smoothed over truth | other walk, undecided |\n"
        "|---|---|---|---|---|---|---|"
    )
    with Pool(2) as pool:
        for case in cases:
            print("\n".join(table(case, records, draws, more, pool)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
