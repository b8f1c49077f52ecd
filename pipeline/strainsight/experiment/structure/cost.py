"""What the stages that solve the whole model cost, before they run: processor seconds and peak memory (docs/scaling.md).

    seconds = c₀ + c₁ N + c₂ N^1.5 e^1.2        GiB = c₀ + c₁ N + c₂ N^1.1 e^1.2

N unknowns before the supports; e elements through the thickness. The exponents of N are those of nested dissection in the plane
(George 1973), where e = 1; that of e was fitted to cubes, where e goes up to 6.4. Measured on one machine; within a factor of two
on all that was measured there.

    seconds = 3.4 + s m (3.9e-3 + 4.1e-6 n² + 8.3e-8 n³)        GiB = 0.15 + 6e-8 s m n

s scenarios, m candidates, n states. n is a guess, as the reduced coordinates are known after `rom` only: those of a load may be
fewer, and where materials vary apart, half of the shapes of the other samples are counted. Powers of n as in the table of states
and scenarios there; constants from whole runs. Memory is that of a row of n for every candidate in every scenario.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from strainsight.config.placement import PlacementConfig
from strainsight.fem.affine import of_stiffness

FLOPS, FILL, THICK = 1.5, 1.1, 1.2
"""Exponents of N in the work and in the fill of a factor in the plane, and of e in both."""
OF_A_PROCESS = 1.2
"""[s] of imports that the measured seconds of every stage have in them."""
MEASURED_MODES, MORE_MODES = 10, 45.0
"""Modes of the measured runs; so many more take as long again."""
BESIDE_SAMPLES = 3
"""Factors with modes of `rom`, beside its samples, where materials vary apart."""
BULK_AND_THIN = {
    "tet4": (1 / 6, 1 / 3),
    "tet10": (4 / 3, 2.0),
    "hex8": (1.0, 2.0),
    "hex20": (4.0, 7.0),
    "wedge6": (1 / 2, 1.0),
    "wedge15": (5 / 2, 9 / 2),
    "pyra5": (1 / 3, 1 / 2),
}
"""Nodes per element of a regular mesh, all round and in a wall of one layer; six tetrahedra or pyramids, two wedges to a cell."""


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
"""The stages that factorise the whole model; `spectrum` is `modes` with those of the truth."""


@dataclass(frozen=True)
class Size:
    """unknowns: three a node; elements through the thickness; regions of the mesh."""

    unknowns: int
    elements: float
    regions: int = 1


@dataclass(frozen=True)
class Cost:
    """seconds of one processor; memory [GiB], the peak."""

    seconds: float
    memory: float


def size_of(nodes: int, elements: Mapping[str, int], regions: int = 1) -> Size:
    """elements: kind → how many. e = (thin − bulk)/(nodes per element − bulk) of regular meshes, at least 1; at most the cube's
    third, N^⅓/3 nodes a side."""
    bulk, thin = (sum(BULK_AND_THIN[kind][i] * count for kind, count in elements.items()) for i in (0, 1))
    most = max(1.0, nodes ** (1 / 3) / 3)
    through = (thin - bulk) / (nodes - bulk) if nodes > bulk else most
    return Size(3 * nodes, min(max(through, 1.0), most), regions)


def cost_of(stage: str, config: PlacementConfig, size: Size) -> Cost:
    """What `modes`, `rom` or `spectrum` of this config will take."""
    law = "rom" if stage == "rom" else "modes"
    modes = config.validation.truth.modes if stage == "spectrum" else config.rom.modes
    seconds = SECONDS[law](size.unknowns, size.elements) - OF_A_PROCESS
    seconds *= max(1.0, 1 + (modes - MEASURED_MODES) / MORE_MODES)
    if stage == "rom" and varies_apart(config, size):
        one = SECONDS["modes"](size.unknowns, size.elements) - OF_A_PROCESS
        seconds = (config.rom.parameter_samples + BESIDE_SAMPLES) * one
    return Cost(seconds, MEMORY[law](size.unknowns, size.elements))


def varies_apart(config: PlacementConfig, size: Size) -> bool:
    """Whether moduli vary, or springs, that do not scale the whole body."""
    moduli = [parameter for parameter in config.parameters.values() if of_stiffness(parameter.property)]
    return len(moduli) > 1 or (len(moduli) == 1 and (size.regions > 1 or moduli[0].springs is not None))


LONG, LARGE = 60.0, 1.0
"""[s] and [GiB] that are worth a word."""


def cost_of_place(config: PlacementConfig, size: Size) -> Cost | None:
    """None where the candidates have no number (`screen.keep: all`)."""
    if config.screen.keep == "all":
        return None
    return cost_of_pool(config.screen.keep, states_of(config, varies_apart(config, size)), scenarios_of(config))


def cost_of_pool(m: int, n: int, s: int) -> Cost:
    """Of m candidates, n states and s scenarios."""
    each = 3.9e-3 + 4.1e-6 * n**2 + 8.3e-8 * n**3
    return Cost(3.4 + s * m * each, 0.15 + 6e-8 * s * m * n)


def of_pool_in_words(config: PlacementConfig, m: int, n: int) -> str:
    """What a pool of m candidates costs as it is now known, with its n states; empty where it is not worth a word."""
    cost = cost_of_pool(m, n, scenarios_of(config))
    if cost.seconds < LONG and cost.memory < LARGE:
        return ""
    minutes = cost.seconds / 60
    time = f"{minutes / 60:.2g} h" if minutes > 90 else f"{minutes:.2g} min"
    return (
        f"place of {m} candidates, {n} states and {scenarios_of(config)} scenarios takes about {time} of processor time and "
        f"{cost.memory:.2g} GiB, within a factor of three; a smaller screen.keep takes a share of it"
    )


def states_of(config: PlacementConfig, apart: bool = False) -> int:
    """n: motion of every mode and of the static response to every load, two states of an unknown load, the parameters; apart:
    whether shapes change with the parameters."""
    unknown = sum(not load.known for load in config.loads.values())
    shapes = config.rom.modes + len(config.loads)
    others = shapes * (config.rom.parameter_samples - 1) // 2 if apart else 0
    return 2 * (shapes + others + unknown) + _parameters(config)


def scenarios_of(config: PlacementConfig) -> int:
    """s: instants at every parameter sample of every load case; without a parameter all instants are alike, and one is taken."""
    instants = config.place.instants if _parameters(config) else 1
    return instants * config.place.parameter_samples * max(1, len(config.place.load_cases or {}))


def _parameters(config: PlacementConfig) -> int:
    return sum(name in config.parameters for name in config.place.estimate)
