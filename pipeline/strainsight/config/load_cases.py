"""Load cases: several trainings, each with its own loads and weight, as scenarios of one placement."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from strainsight.config.base import Amplitude, Duration, Frequency, Name, Positive, Section, TimeStep
from strainsight.config.loads import Load, LoadSignal, Recorded, Settle, signal_problems
from strainsight.config.plausible import DURATION, Plausible
from strainsight.config.problem import Problem, known


class CaseLoad(Section):
    """What a load looks like in one load case."""

    signal: LoadSignal = Field(description="What it looks like in that case.")
    frequency: Frequency | None = Field(
        None,
        description="Typical frequency of an unknown load there [Hz]; null: as process_noise of the load has it, else that of "
        "this signal.",
    )
    amplitude: Amplitude | None = Field(
        None,
        description="Its typical amplitude there [unit of the load], which its σ counts in; null: as process_noise of the load "
        "has it, else that of this signal.",
    )


CaseEntry = Annotated[
    Annotated[CaseLoad, Tag("load")] | Annotated[Literal["none"], Tag("silent")],
    Discriminator(lambda value: "silent" if isinstance(value, str) else "load"),
]


class TrainingCase(Section):
    """One of the trainings that a layout has to serve. What it does not state is as in `loads` and `train`."""

    weight: Annotated[Positive, Plausible(1e-6, 1e6)] = Field(
        1.0,
        description="What the case counts [-], beside the weights of the others: its share of the mean, or its factor in the "
        "worst; of variances, so that 4 stands for half the σ.",
    )
    loads: dict[Name, CaseEntry] = Field(
        {},
        description="Loads that are other than stated, by name, or none: silent. Others act as stated. A silent load stays an "
        "unknown of the filter, with the process noise that it has as stated, and is left out of the criterion in that case.",
    )
    duration: Duration | None = Field(None, description="Length of this training [s]; null: train.duration.")
    time_step: TimeStep | None = Field(
        None,
        description="Its time step [s]; null: train.time_step, at which noise_std is that of a sample in every case.",
    )
    settle: Annotated[Settle | None, DURATION] = Field(None, description="How its motion begins; null: train.settle.")


def silent_in(case: TrainingCase) -> frozenset[str]:
    """The loads that do not act in a case."""
    return frozenset(name for name, entry in case.loads.items() if not isinstance(entry, CaseLoad))


def load_case_problems(
    cases: Mapping[str, TrainingCase], loads: Mapping[str, Load], estimate: Sequence[str], over: Sequence[str]
) -> Iterator[Problem]:
    """Contradictions between load cases and loads; estimate: the unknowns, over: those that the criterion covers."""
    for name, case in cases.items():
        key, silent = f"place.load_cases.{name}", silent_in(case)
        for load, entry in case.loads.items():
            yield from known(f"{key}.loads.{load}", load, loads, "load")
            if load in loads and isinstance(entry, CaseLoad):
                yield from _entry(f"{key}.loads.{load}", entry, loads[load])
        if silent >= set(loads):
            yield Problem(f"{key}.loads", "no load acts in this case", "let one act, or remove the case")
        elif silent >= set(over):
            listed = ", ".join(over)
            yield Problem(
                f"{key}.loads",
                f"{listed} {'is' if len(over) == 1 else 'are'} silent, and the criterion covers nothing else in this case",
                "let one of them act, or remove the case",
            )
    for unknown in estimate:
        if unknown in loads and all(unknown in silent_in(case) for case in cases.values()):
            yield Problem(
                "place.load_cases",
                f"the unknown load '{unknown}' is silent in every case",
                f"let {unknown} act in one of them",
            )


def _entry(key: str, entry: CaseLoad, load: Load) -> Iterator[Problem]:
    yield from signal_problems(f"{key}.signal", entry.signal)
    stated = entry.frequency if entry.frequency is not None else load.process_noise.frequency
    if not load.known and isinstance(entry.signal, Recorded) and stated is None:
        yield Problem(
            f"{key}.frequency",
            "an unknown load from a recorded signal needs a typical frequency",
            f"give {key}.frequency [Hz]",
            at_key=True,
        )
