"""Limits to try a layout on: cases of them, and a second statement of what each allows."""

from __future__ import annotations

import numpy as np

from strainsight.placement.limits import limits_of

POOL = 11


class Rules:
    """The limits once more, in words that a test can check."""

    def __init__(self, keep, *, fixed=(), size=None, price=None, budget=None, near=(), zones=()):
        self.keep, self.fixed, self.near, self.zones = keep, fixed, near, zones
        self.size = np.ones(POOL, dtype=int) if size is None else size
        self.price, self.budget = price, budget
        self.limits = limits_of(
            POOL, keep, fixed=fixed, size=size, price=price, budget=budget, near=np.array(near), zones=zones
        )

    def hold(self, units, least=True):
        units = [int(u) for u in units]
        total = sum(self.size[u] for u in units)
        spare = 0 if self.size.max() == 1 else 1
        return (
            total <= self.keep
            and (not least or self.budget is not None or total >= self.keep - spare)
            and set(self.fixed) <= set(units)
            and not any({a, b} <= set(units) and (a == b or not {a, b} <= set(self.fixed)) for a, b in self.near)
            and all(sum(int(members[u]) for u in units) <= most for _, members, most in self.zones)
            and (self.budget is None or sum(self.price[u] for u in units) <= self.budget * (1 + 2e-9))
        )


def zone(name, members, most):
    return (name, np.isin(np.arange(POOL), members), most)


PRICE = np.array([3.0, 1.0, 2.5, 0.7, 1.1, 4.0, 0.0, 2.2, 1.3, 0.9, 5.0])
PAIRS = np.array([2] * 6 + [1] * 5)
NEAR = [(0, 1), (1, 2), (0, 2), (2, 3), (4, 5), (5, 6), (7, 10), (8, 9), (9, 10)]
CASES = {
    "count": lambda: Rules(4),
    "fixed": lambda: Rules(4, fixed=(2, 9)),
    "spacing": lambda: Rules(4, near=NEAR),
    "spacing, fixed": lambda: Rules(4, near=NEAR, fixed=(5,)),
    "zones": lambda: Rules(
        4, zones=[zone("place.at_most.0", [0, 1, 2, 3, 4, 5], 1), zone("place.at_most.1", [5, 6, 7], 1)]
    ),
    "a fixed gauge in two zones": lambda: Rules(
        4, fixed=(5,), zones=[zone("place.at_most.0", [0, 2, 5, 8], 1), zone("place.at_most.1", [3, 4, 5, 6], 2)]
    ),
    "budget": lambda: Rules(4, price=PRICE, budget=4.3),
    "generous budget": lambda: Rules(3, price=PRICE, budget=100.0),
    "tight budget": lambda: Rules(5, price=PRICE, budget=1.6),
    "budget, zone, spacing": lambda: Rules(
        4, price=PRICE, budget=5.0, near=NEAR, zones=[zone("place.at_most.0", [3, 6, 9], 1)]
    ),
    "all cost nothing": lambda: Rules(3, price=np.zeros(POOL), budget=0.0),
    "pairs": lambda: Rules(4, size=PAIRS),
    "pairs, odd": lambda: Rules(5, size=PAIRS),
    "pairs, fixed": lambda: Rules(5, size=PAIRS, fixed=(1, 8)),
    "pairs, spacing": lambda: Rules(4, size=PAIRS, near=NEAR),
    "pairs too near to their mirror images": lambda: Rules(5, size=PAIRS, near=[*NEAR, (0, 0), (3, 3), (9, 9)]),
    "fixed too near to one another": lambda: Rules(4, near=[*NEAR, (1, 3), (5, 9)], fixed=(1, 2, 3)),
    "pairs, budget": lambda: Rules(5, size=PAIRS, price=PRICE, budget=5.2),
}
