"""The unknowns of a bench's estimate: which of its parameters the filter has wrong, and which of these it estimates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.cases.bench.bench import Bench
from strainsight.cases.bench.inverse.load_models import increments_of, load_process_of
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.connections import Driven
from strainsight.config.bench.estimate import Estimate, EstimatedParameter
from strainsight.errors import blame
from strainsight.multibody.bearing.geometry import PARAMETERS
from strainsight.multibody.inverse.loads import LoadProcess
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


def unknowns_of(config: BenchConfig, bench: Bench, h: float) -> Unknowns:
    """What the config's `estimate` says, h [s] the filter's step: σ a step is σ a second times h where it asks for that."""
    system, estimate = bench.system, asked(config)
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
