"""Forecast of processor time and peak memory of the long stages (docs/scaling.md).

    seconds = c₀ + c₁ N + c₂ N^1.5 e^1.2        GiB = c₀ + c₁ N + c₂ N^1.1 e^1.2

N unknowns before the supports; e elements through the thickness. The exponents of N are those of nested dissection in the plane
(George 1973), where e = 1; that of e was fitted to cubes with e up to 6.4. Fitted on one machine, within a factor of two.

    seconds = 3.4 + s m (3.9e-3 + 4.1e-6 n² + 8.3e-8 n³)        GiB = 0.15 + 6e-8 s m n

s scenarios, m candidates, n states. n is an estimate, as the reduced basis is known only after `rom`. If materials vary
independently, half of the shapes of the other samples are counted. Memory: one row of n for every candidate and scenario.

`validate`: seconds = 3.5 + 4.5e-5 N + (r k² + 8 k³)(0.7 + B)(0.01 + 3e-5 T), k = n/23        GiB = 0.35 + 4.7e-6 N
`report`:   seconds = 4.5 + 2.5e-5 N

r filter runs of T time steps in addition to that of the layout, which has a smoother and other filters for comparison; B points
of the parameter grid. The truth and the picture are linear in N. Memory of `report` is below that of `validate`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from strainsight.config.placement import PlacementConfig
from strainsight.fem.affine import of_stiffness

FLOPS, FILL, THICK = 1.5, 1.1, 1.2
"""Exponents of N in work and fill of a factorisation in the plane, and of e in both."""
IMPORT_TIME = 1.2
"""[s] for imports, included in the measured time of every stage."""
MEASURED_MODES, MORE_MODES = 10, 45.0
"""Modes of the measured runs, and number of further modes that doubles the time."""
EXTRA_FACTORS = 3
"""Factorisations with modes in `rom` in addition to its samples, if materials vary independently."""
BULK_AND_THIN = {
    "tet4": (1 / 6, 1 / 3),
    "tet10": (4 / 3, 2.0),
    "hex8": (1.0, 2.0),
    "hex20": (4.0, 7.0),
    "wedge6": (1 / 2, 1.0),
    "wedge15": (5 / 2, 9 / 2),
    "pyra5": (1 / 3, 1 / 2),
}
"""Nodes per element of a regular mesh, in bulk and in a wall of one layer; six tetrahedra or pyramids, two wedges a cell."""


@dataclass(frozen=True)
class Law:
    """c₀ + c₁ N + c₂ N^p e^1.2."""

    constant: float
    linear: float
    factor: float
    power: float

    def __call__(self, unknowns: float, elements: float) -> float:
        return self.constant + self.linear * unknowns + self.factor * unknowns**self.power * elements**THICK


SECONDS = {"modes": Law(1.8, 4.8e-5, 9.2e-8, FLOPS), "rom": Law(2.1, 5.9e-5, 4.0e-8, FLOPS)}
MEMORY = {"modes": Law(0.13, 8.4e-6, 3.0e-7, FILL), "rom": Law(0.13, 9.0e-6, 3.0e-7, FILL)}
SOLVES = ("modes", "rom", "spectrum")
"""Stages that factorise the full model; `spectrum` costs as `modes` with the modes of the truth."""


@dataclass(frozen=True)
class Size:
    """unknowns: three per node; elements: through the thickness; regions: of the mesh."""

    unknowns: int
    elements: float
    regions: int = 1


@dataclass(frozen=True)
class Cost:
    """seconds: processor time; memory: peak [GiB]."""

    seconds: float
    memory: float


def size_of(nodes: int, elements: Mapping[str, int], regions: int = 1) -> Size:
    """Estimate e = (thin − bulk)/(nodes per element − bulk) from regular meshes, 1 ≤ e ≤ N^⅓/3; elements: kind → number."""
    bulk, thin = (sum(BULK_AND_THIN[kind][i] * count for kind, count in elements.items()) for i in (0, 1))
    most = max(1.0, nodes ** (1 / 3) / 3)
    through = (thin - bulk) / (nodes - bulk) if nodes > bulk else most
    return Size(3 * nodes, min(max(through, 1.0), most), regions)


FORECAST = (*SOLVES, "place", "validate", "report")
"""Stages with a forecast."""


def cost_of(stage: str, config: PlacementConfig, size: Size) -> Cost | None:
    """Cost of a stage of `FORECAST` with this config; None for `place` with an unknown number of candidates."""
    if stage == "place":
        return cost_of_place(config, size)
    if stage == "validate":
        return cost_of_validate(config, size)
    return cost_of_report(size) if stage == "report" else cost_of_solve(stage, config, size)


def cost_of_solve(stage: str, config: PlacementConfig, size: Size) -> Cost:
    """Cost of `modes`, `rom` or `spectrum` with this config."""
    law = "rom" if stage == "rom" else "modes"
    modes = config.validation.truth.modes if stage == "spectrum" else config.rom.modes
    seconds = SECONDS[law](size.unknowns, size.elements) - IMPORT_TIME
    seconds *= max(1.0, 1 + (modes - MEASURED_MODES) / MORE_MODES)
    if stage == "rom" and varies_apart(config, size):
        one = SECONDS["modes"](size.unknowns, size.elements) - IMPORT_TIME
        seconds = (config.rom.parameter_samples + EXTRA_FACTORS) * one
    return Cost(seconds, MEMORY[law](size.unknowns, size.elements))


def varies_apart(config: PlacementConfig, size: Size) -> bool:
    """Whether a modulus or spring stiffness varies that does not scale the whole body."""
    moduli = [parameter for parameter in config.parameters.values() if of_stiffness(parameter.property)]
    return len(moduli) > 1 or (len(moduli) == 1 and (size.regions > 1 or moduli[0].springs is not None))


LONG, LARGE = 60.0, 1.0
"""Time [s] and memory [GiB] from which a forecast is reported."""


def cost_of_place(config: PlacementConfig, size: Size) -> Cost | None:
    """Cost of `place`, None if the number of candidates is unknown (`screen.keep: all`)."""
    if config.screen.keep == "all":
        return None
    return cost_of_pool(config.screen.keep, states_of(config, varies_apart(config, size)), scenarios_of(config))


def cost_of_pool(m: int, n: int, s: int) -> Cost:
    """Cost of `place` with m candidates, n states and s scenarios."""
    each = 2.4e-3 + s * (1.2e-6 * n**2 + 5.8e-8 * n**3)
    return Cost(3.4 + m * each, 0.15 + 6e-8 * s * m * n)


def of_pool_in_words(config: PlacementConfig, m: int, n: int) -> str:
    """Forecast for a pool of m candidates and n states, empty if short."""
    combinations = scenarios_of(config)
    cost = cost_of_pool(m, n, combinations)
    if cost.seconds < LONG and cost.memory < LARGE:
        return ""
    minutes = cost.seconds / 60
    time = f"{minutes / 60:.2g} h" if minutes > 90 else f"{minutes:.2g} min"
    return (
        f"the stage `place` with {m} candidates, {n} states and {combinations} combinations of instant, parameter sample and "
        f"load case takes about {time} of processor time and {cost.memory:.2g} GiB of memory, within a factor of three. Reduce "
        "screen.keep to save time"
    )


GRID_POINTS = (1, 9, 59, 329)
"""Points of the parameter grid for up to three parameters."""


def cost_of_validate(config: PlacementConfig, size: Size) -> Cost:
    """Cost of `validate` with this config."""
    settings, by_grid = config.validation, config.filter.method == "grid"
    points = GRID_POINTS[min(_parameters(config), 3)] if by_grid else 1
    steps = settings.duration / settings.time_step
    k = states_of(config, varies_apart(config, size)) / 23
    runs = runs_of(config) * k**2 + 8 * k**3
    seconds = 3.5 + 4.5e-5 * size.unknowns + runs * (0.7 + points) * (0.01 + 3e-5 * steps)
    return Cost(seconds, memory_of_validate(size))


def runs_of(config: PlacementConfig) -> int:
    """Number of filter runs r of `validate` in addition to that of the layout."""
    studies, sweeps = config.studies, config.validation.sweeps
    swept = len(sweeps.time_steps) + len(sweeps.process_noise) + sum(map(len, sweeps.wrong_parameters.values()))
    return studies.repeats + 2 * studies.random_sets + len(studies.noise_factors) + swept


def memory_of_validate(size: Size) -> float:
    """Peak memory of `validate` [GiB], not exceeded by `report`."""
    return 0.35 + 4.7e-6 * size.unknowns


def cost_of_report(size: Size) -> Cost:
    """Cost of `report`."""
    return Cost(4.5 + 2.5e-5 * size.unknowns, memory_of_validate(size))


def states_of(config: PlacementConfig, varying: bool = False) -> int:
    """Number of states n: two per mode and static response, two per unknown load, one per parameter; varying: whether shapes
    change with the parameters."""
    unknown = sum(not load.known for load in config.loads.values())
    shapes = config.rom.modes + len(config.loads)
    others = shapes * (config.rom.parameter_samples - 1) // 2 if varying else 0
    return 2 * (shapes + others + unknown) + _parameters(config)


def scenarios_of(config: PlacementConfig) -> int:
    """Number of scenarios s: instants (one without parameters) times parameter samples times load cases."""
    instants = config.place.instants if _parameters(config) else 1
    return instants * config.place.parameter_samples * max(1, len(config.place.load_cases or {}))


def _parameters(config: PlacementConfig) -> int:
    return sum(name in config.parameters for name in config.place.estimate)
