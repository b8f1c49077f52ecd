"""What variances are made of."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.records.record import dataset, record


@record
class Budget:
    """What the variance of every unknown is made of."""

    source: tuple[str, ...] = dataset("1", "/source", "where a part of the variance comes from")
    share: dict[str, np.ndarray] = dataset("1", "/source", "share of every source in the variance of <name>, filtered")

    @property
    def shares(self) -> dict[str, dict[str, float]]:
        """Name → source → share."""
        return {name: dict(zip(self.source, own.tolist(), strict=True)) for name, own in self.share.items()}


def budget_of_shares(shares: Mapping[str, Mapping[str, float]]) -> Budget | None:
    """Of name → source → share, each with the same sources; None of nothing."""
    sources = tuple(next(iter(shares.values()), ()))
    share = {name: np.array([own[source] for source in sources]) for name, own in shares.items()}
    return Budget(source=sources, share=share) if sources else None
