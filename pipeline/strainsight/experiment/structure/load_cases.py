"""The training runs of a placement: that under the loads as stated, and one for every load case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from strainsight.config.load_cases import CaseLoad, TrainingCase, silent_in
from strainsight.config.loads import Settle
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, blame
from strainsight.experiment.histories import signal_of
from strainsight.experiment.structure.settings import characteristic
from strainsight.experiment.structure.start import Loading, loading_of
from strainsight.loads.histories import Constant, Signal


@dataclass(frozen=True)
class Run:
    """One training run.

    name of its load case, "" of the loads as stated; key of the config that it stands under; weight [-] of the case; duration,
    time_step [s]; settle: how the motion begins; signals by load; silent: the loads that do not act.
    """

    name: str
    key: str
    weight: float
    duration: float
    time_step: float
    settle: Settle
    signals: Mapping[str, Signal]
    silent: frozenset[str]

    def loading(self) -> Loading:
        """The loads from t = 0 on, and before."""
        steps = round(self.duration / self.time_step)
        return loading_of(self.settle, list(self.signals.values()), self.time_step, steps)


def run_as_stated(config: PlacementConfig, inputs: Sequence[str], files: Mapping[str, Path]) -> Run:
    """The run under the loads as stated; inputs: of the model, in its order, which may not be that of the config."""
    train = config.train
    with blame("train"):
        signals = {name: signal_of(name, config.loads[name].signal, files) for name in inputs}
    return Run("", "train", 1.0, train.duration, train.time_step, train.settle, signals, frozenset())


def runs_of(config: PlacementConfig, inputs: Sequence[str], files: Mapping[str, Path]) -> tuple[Run, ...]:
    """Those of the load cases in the order of their names, none where the config has none."""
    cases = config.place.load_cases or {}
    return tuple(_run(config, name, cases[name], inputs, files) for name in sorted(cases))


def _run(
    config: PlacementConfig, name: str, case: TrainingCase, inputs: Sequence[str], files: Mapping[str, Path]
) -> Run:
    train, key, silent = config.train, f"place.load_cases.{name}", silent_in(case)
    signals: dict[str, Signal] = {}
    with blame(key):
        for own in inputs:
            entry = case.loads.get(own)
            if own in silent:
                signals[own] = Constant(0.0)
            elif isinstance(entry, CaseLoad):
                signals[own] = signal_of(own, entry.signal, files, f"{key}.loads")
            else:
                signals[own] = signal_of(own, config.loads[own].signal, files)
    return Run(
        name,
        key,
        case.weight,
        train.duration if case.duration is None else case.duration,
        train.time_step if case.time_step is None else case.time_step,
        train.settle if case.settle is None else case.settle,
        signals,
        silent,
    )


def typical_of(
    config: PlacementConfig, run: Run, names: Sequence[str], files: Mapping[str, Path]
) -> dict[str, tuple[float, float]]:
    """Frequency [Hz] and amplitude of some unknown loads in a run: as its case states them, else as process_noise of the load or
    the signal have them. A silent load has those that it has as stated: its filter does not know that it is silent."""
    stated = config.place.load_cases[run.name].loads if run.name and config.place.load_cases else {}
    found = {}
    for name in names:
        load, entry = config.loads[name], stated.get(name)
        if name in run.silent:
            found[name] = characteristic(load, signal_of(name, load.signal, files), config.train.duration)
            continue
        frequency, amplitude = characteristic(load, run.signals[name], run.duration)
        if isinstance(entry, CaseLoad):
            frequency = frequency if entry.frequency is None else entry.frequency
            amplitude = amplitude if entry.amplitude is None else entry.amplitude
        if run.name and amplitude == 0:
            raise ConfigError(
                f"load '{name}' is zero throughout this case",
                key=f"{run.key}.loads.{name}",
                remedy=f"state {name}: none",
            )
        found[name] = frequency, amplitude
    return found
