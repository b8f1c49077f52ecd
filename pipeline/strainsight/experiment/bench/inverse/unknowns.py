"""The unknowns of a bench's estimate: which of its parameters the filter has wrong, and which of these it estimates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.connections import Driven, Load
from strainsight.config.bench.estimate import Estimate, EstimatedParameter
from strainsight.config.loads import Sine
from strainsight.errors import blame
from strainsight.experiment.bench.bench import Bench
from strainsight.loads.input_models import WALK, input_model
from strainsight.multibody.bearing.geometry import PARAMETERS
from strainsight.multibody.inverse.loads import LoadProcess, load_process
from strainsight.multibody.inverse.parameters import ParameterCoordinates, parameter_coordinates


@dataclass(frozen=True)
class Unknowns:
    """inputs (nu,): places of the unknown loads in `system.inputs`, with σ at the start and of their change in a step [N, N m];
    loads: how they move;
    parameters: name in the config → name in the system; free: those of them that are estimated; starts (s, nθ): what the
    filter takes θ for, one row a start; std, increment (p,) of the free ones [m, Pa]; coordinates of them."""

    inputs: np.ndarray
    std_u: np.ndarray
    increment_u: np.ndarray
    loads: LoadProcess
    parameters: Mapping[str, str]
    free: tuple[str, ...]
    starts: np.ndarray
    std: np.ndarray
    increment: np.ndarray
    coordinates: ParameterCoordinates


def asked(config: BenchConfig) -> Estimate:
    """The section `estimate`, which is there where something is estimated."""
    assert config.estimate is not None
    return config.estimate


def has_bank(config: BenchConfig) -> bool:
    """Whether a bank has the parameters; without any there is nothing for it."""
    estimate = asked(config)
    return estimate.method.parameters == "bank" and any(own.std is not None for own in estimate.parameters.values())


def corrects(config: BenchConfig) -> bool:
    """Whether the filter allows for what its step leaves out: as in a test, unless the truth is made by that very step."""
    estimate = asked(config)
    by_own_step = estimate.measured is None and estimate.truth.model == "own"
    return corrects_in_a_test(config) and (estimate.method.step_error is not None or not by_own_step)


def corrects_in_a_test(config: BenchConfig) -> bool:
    """The same where the bench itself moves: where it is asked to, else unless step or noise are the thesis's, which takes the
    step for true, or a joint is driven: along the motions that a drive leaves the bench is not linear in a step."""
    stated, printed = asked(config).method.step_error, asked(config).method.noise == "as_printed"
    if stated is not None or printed:
        return stated == "estimated"
    return config.simulate.method == "second_order" and not has_drives(config)


def has_drives(config: BenchConfig) -> bool:
    return any(isinstance(joint, Driven) for joint in config.joints.values())


def has_other_poses(config: BenchConfig) -> bool:
    """Whether drives, or gravity that turns, take the bench from where it starts."""
    return has_drives(config) or any(own.type == "gravity" and own.turns is not None for own in config.forces.values())


def free_properties(estimate: Estimate) -> dict[str, tuple[str, ...]]:
    """Bearing → its properties that the estimate names, in the order of PARAMETERS."""
    found: dict[str, list[str]] = {}
    for entry in estimate.parameters.values():
        if entry.bearing is not None and entry.property is not None:
            found.setdefault(entry.bearing, []).append(entry.property)
    return {bearing: tuple(sorted(own, key=PARAMETERS.index)) for bearing, own in found.items()}


def parameter_units(config: BenchConfig, names: Iterable[str]) -> dict[str, str]:
    """Pa of a modulus, m of what a bearing has."""
    return {name: "Pa" if asked(config).parameters[name].bearing is None else "m" for name in names}


def unknowns_of(bench: Bench, h: float) -> Unknowns:
    """What the config's `estimate` says, h [s] the filter's step: σ a step is σ a second times h where it asks for that."""
    config, system, estimate = bench.config, bench.system, asked(bench.config)
    a_step = h if estimate.increments == "second" else 1.0
    entries = list(estimate.inputs.values())
    places = {name: _system_name(name, entry) for name, entry in estimate.parameters.items()}
    theta = bench.theta.copy()
    for name, entry in estimate.parameters.items():
        if entry.guess is not None:
            theta[system.parameters.index(places[name])] = entry.guess
    std = {name: entry.std for name, entry in estimate.parameters.items() if entry.std is not None}
    free = tuple(std)
    starts = [theta]
    for name in free:
        for value in estimate.parameters[name].starts:
            starts.append(theta.copy())
            starts[-1][system.parameters.index(places[name])] = value
    with blame("estimate.parameters"):
        coordinates = parameter_coordinates(
            system.parameters,
            [places[name] for name in free],
            theta,
            {name: bearing.parameters for name, bearing in bench.bearings.items()},
        )
        for start in starts:
            coordinates.xi(start)
    return Unknowns(
        np.array([system.inputs.index(name) for name in estimate.inputs], dtype=int),
        np.array([entry.std for entry in entries]),
        increments_of(config, h),
        load_process_of(config, h),
        places,
        free,
        np.array(starts),
        np.array(list(std.values()), dtype=float),
        np.array([estimate.parameters[name].increment * a_step for name in free]),
        coordinates,
    )


def _system_name(name: str, entry: EstimatedParameter) -> str:
    return name if entry.bearing is None else f"{entry.bearing}.{entry.property}"


def load_process_of(config: BenchConfig, h: float) -> LoadProcess:
    """Of all unknown loads in their order, in steps of h [s]."""
    models, amplitudes = [], []
    for name, entry in asked(config).inputs.items():
        walks = entry.model == "random_walk"
        frequency, amplitude = (1.0, 1.0) if walks else typical_of(config, name)
        models.append(input_model(entry.model, frequency, entry.kappa, entry.smoothness, entry.damping))
        amplitudes.append(amplitude)
    return load_process(models, np.array(amplitudes), increments_of(config, h), h)


def increments_of(config: BenchConfig, h: float) -> np.ndarray:
    """σ (nu,) of the change of every unknown load in a step of h [s] [N, N m]: as stated; of a walk that states none a √(κωh), of
    the other models about aωh, at most a."""
    estimate, found = asked(config), []
    for name, entry in estimate.inputs.items():
        if entry.increment is not None:
            found.append(entry.increment * (h if estimate.increments == "second" else 1.0))
            continue
        frequency, amplitude = typical_of(config, name)
        turned = 2 * np.pi * frequency * h
        if entry.model == "random_walk":
            found.append(amplitude * float(np.sqrt((WALK if entry.kappa is None else entry.kappa) * turned)))
        else:
            found.append(amplitude * min(1.0, turned))
    return np.array(found)


def typical_of(config: BenchConfig, name: str) -> tuple[float, float]:
    """Frequency [Hz] and amplitude [N, N m] of an unknown load: as stated, else of the sine that its history is."""
    entry, force = asked(config).inputs[name], config.forces[name]
    assert isinstance(force, Load)
    sine = force.signal if isinstance(force.signal, Sine) else None
    frequency = entry.frequency or (None if sine is None else sine.frequency)
    amplitude = entry.amplitude or (None if sine is None else sine.amplitude)
    assert frequency is not None  # checked with the config
    assert amplitude is not None
    return frequency, amplitude
