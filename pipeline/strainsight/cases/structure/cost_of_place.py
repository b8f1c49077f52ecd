"""What `place` costs, before it runs: processor seconds and peak memory, to a factor of three (docs/scaling.md).

    seconds = 3.4 + s m (3.9e-3 + 4.1e-6 n² + 8.3e-8 n³)        GiB = 0.15 + 8e-6 m

s scenarios, m candidates, n states. n is an upper guess, as the reduced coordinates are known after `rom` only: those of a load
may be fewer. Powers of n as in the table of states and scenarios there; constants from whole runs.
"""

from __future__ import annotations

from strainsight.cases.structure.cost import Cost
from strainsight.config.placement import PlacementConfig


def cost_of_place(config: PlacementConfig) -> Cost | None:
    """None where the candidates have no number (`screen.keep: all`)."""
    m, n = config.screen.keep, states_of(config)
    if m == "all":
        return None
    each = 3.9e-3 + 4.1e-6 * n**2 + 8.3e-8 * n**3
    return Cost(3.4 + scenarios_of(config) * m * each, 0.15 + 8e-6 * m)


def states_of(config: PlacementConfig) -> int:
    """n: motion of every mode and of the static response to every load, two states of an unknown load, the parameters."""
    unknown = sum(not load.known for load in config.loads.values())
    return 2 * (config.rom.modes + len(config.loads) + unknown) + _parameters(config)


def scenarios_of(config: PlacementConfig) -> int:
    """s: instants at every parameter sample of every load case; without a parameter all instants are alike, and one is taken."""
    instants = config.place.instants if _parameters(config) else 1
    return instants * config.place.parameter_samples * max(1, len(config.place.load_cases or {}))


def _parameters(config: PlacementConfig) -> int:
    return sum(name in config.parameters for name in config.place.estimate)
