"""What `place` costs, before it runs: processor seconds and peak memory, to a factor of three (docs/scaling.md).

    seconds = 3.4 + s m (3.9e-3 + 4.1e-6 n² + 8.3e-8 n³)        GiB = 0.15 + 6e-8 s m n

s scenarios, m candidates, n states. n is a guess, as the reduced coordinates are known after `rom` only: those of a load may be
fewer, and where materials vary apart, half of the shapes of the other samples are counted. Powers of n as in the table of states
and scenarios there; constants from whole runs. Memory is that of a row of n for every candidate in every scenario.
"""

from __future__ import annotations

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.cost import Cost, Size, varies_apart

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
