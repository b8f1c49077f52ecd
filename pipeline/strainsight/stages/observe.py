"""observe: which unknowns the pool could tell apart, for all seven cases of tables 6.1 and 6.2."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np

from strainsight.augmentation.cases import Case, cases
from strainsight.cases.structure.channels import channels_of, largest_of_quantity, readings
from strainsight.cases.structure.settings import characteristic, signal_of
from strainsight.errors import blame
from strainsight.ordering import first_of_largest
from strainsight.records.placed import Observed
from strainsight.records.record import written
from strainsight.rom.modal_step import simulate
from strainsight.rom.model import ReducedModel
from strainsight.signals.histories import Sine, hold_coefficients, instant_values
from strainsight.stages import inputs
from strainsight.workflow.output import Output, Table
from strainsight.workflow.stage import Context, Stage

STEPS_A_PERIOD = 40
PART = 10**7
"""Readings held at once."""


@dataclass(frozen=True)
class Excitation:
    """A motion: label; x (s, 2n) = [q, q̇]; u (s, n_u) [N]."""

    label: str
    x: np.ndarray
    u: np.ndarray


def run(context: Context) -> Output:
    """Every combination of unknown loads, moduli and densities, at the training motion and at every stated frequency."""
    config = context.config
    model, training = inputs.reduced(context).model, inputs.training(context)
    every = channels_of(training, inputs.screened(context))
    pool = np.flatnonzero(np.isin(every.gauge, inputs.screened(context).kept))
    amplitude = {}
    for name in model.inputs:
        signal = signal_of(name, config.loads[name].signal, context.files)
        amplitude[name] = characteristic(config.loads[name], signal, float(config.train.duration))[1]
    unknown = tuple(name for name in model.inputs if not config.loads[name].known) or model.inputs
    properties = {name: config.parameters[name].property for name in model.parameters}
    found: dict[str, tuple[Case, ...]] = {}
    rows, quantity = every.rows[pool], every.quantity[pool]
    for excitation in _excitations(context, model, amplitude):
        largest = _largest(model, rows, quantity, excitation)
        with blame("observe"):
            found[excitation.label] = cases(
                model,
                model.reference,
                excitation.x,
                excitation.u,
                inputs=unknown,
                moduli=[name for name, kind in properties.items() if kind == "youngs_modulus"],
                densities=[name for name, kind in properties.items() if kind == "density"],
                amplitude=amplitude,
                guess=model.reference,
                rows=rows,
                quantity=quantity,
                largest=largest,
                instants=int(config.place.instants),
                seed=context.seed,
            )
    return _output(found)


def _largest(model: ReducedModel, rows: np.ndarray, quantity: np.ndarray, motion: Excitation) -> np.ndarray:
    """For every channel the largest reading of any channel of its quantity (m,); in parts, as pools and motions are long."""
    parts = np.array_split(np.arange(len(motion.x)), max(1, len(motion.x) * len(rows) // PART))
    peaks = [
        np.abs(readings(model, model.reference, rows, quantity, motion.x[part], motion.u[part])).max(axis=0)
        for part in parts
    ]
    return largest_of_quantity(np.array(peaks), quantity)


def _excitations(context: Context, model: ReducedModel, amplitude: dict[str, float]) -> list[Excitation]:
    training, config = inputs.training(context), context.config
    x = np.hstack([training.coordinate, training.velocity])
    found = [Excitation("training run", x, training.load)]
    for frequency in config.observe.frequencies:
        duration = max(float(config.train.duration), 5 / frequency)
        steps = ceil(duration * STEPS_A_PERIOD * frequency)
        signals = [Sine(frequency, amplitude[name], 0.0) for name in model.inputs]
        held = hold_coefficients(signals, 0.0, duration / steps, steps)
        motion = simulate(model, model.reference, held, duration / steps)
        found.append(Excitation(f"{frequency:g} Hz", motion, instant_values(held)))
    return found


def _output(found: dict[str, tuple[Case, ...]]) -> Output:
    labels = [case.label for case in next(iter(found.values()))]
    excitations = list(found)
    table = [[next(c for c in found[e] if c.label == label) for label in labels] for e in excitations]

    def numbers(name: str) -> np.ndarray:
        return np.array([[getattr(case.found, name) for case in row] for row in table])

    lost = [[case.reason or case.found.null_direction for case in row] for row in table]
    rows = tuple(
        (
            " + ".join(table[0][j].unknowns),
            *(f"{table[i][j].found.condition:.3g}" for i in range(len(excitations))),
            *(f"{table[i][j].found.condition_raw:.1e}" for i in range(len(excitations))),
            "; ".join(dict.fromkeys(lost[i][j] for i in range(len(excitations)) if lost[i][j])),
        )
        for j in range(len(labels))
    )
    columns = ("unknown", *(f"condition, {e}" for e in excitations), *(f"raw, {e}" for e in excitations), "nearly lost")
    best = first_of_largest(numbers("condition")[0])
    observed = Observed(
        excitation=tuple(excitations),
        case=tuple(labels),
        unknowns=tuple(", ".join(case.unknowns) for case in table[0]),
        condition=numbers("condition"),
        condition_raw=numbers("condition_raw"),
        sigma_min=numbers("sigma_min"),
        lost=np.array(lost, dtype=np.str_),
    )
    return Output(
        datasets=written(observed),
        summary={
            f"condition.{label}": float(value) for label, value in zip(labels, numbers("condition")[0], strict=True)
        },
        message=f"{len(labels)} cases, the worst {' + '.join(table[0][best].unknowns)}: {table[0][best].found.condition:.2g}",
        tables=(
            Table("observability: condition of the scaled PBH matrix, and the thesis's raw number", columns, rows),
        ),
    )


OBSERVE = Stage(
    "observe",
    version=1,
    reads=("seed", "loads", "parameters.*.property", "train", "observe", "place.instants"),
    upstream=("rom", "train", "screen"),
    files=("loads.*.signal.file",),
    run=run,
)
