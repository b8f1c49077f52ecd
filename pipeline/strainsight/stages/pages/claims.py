"""Whether an estimate kept to the σ that was claimed for it: in the test, after smoothing, over the repeats."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from strainsight.estimation.consistency import claim_of
from strainsight.report.placement.data import Claim
from strainsight.workflow.output import Scalar


def claims_of(name: str, numbers: Mapping[str, Scalar], repeats: tuple[np.ndarray, np.ndarray]) -> tuple[Claim, ...]:
    """All claims of an unknown, first the one that decides: the worst overconfident one, else the most cautious one.

    numbers: the summary of validate; repeats: error and claimed σ (n,) of them. Of a load the smoothed estimate counts, too.
    """
    of: dict[Any, Any] = {"test": (numbers[f"error.{name}"], numbers[f"std.{name}"])}
    if f"zero.{name}" in numbers:
        of["smoothed"] = (numbers[f"smoothed.{name}"], numbers[f"smoothed_std.{name}"])
    of["repeats"] = repeats
    found = [Claim(what, **vars(claim)) for what, values in of.items() if (claim := claim_of(*map(np.asarray, values)))]
    return tuple(sorted(found, key=_weight, reverse=True))


def _weight(claim: Claim) -> tuple[int, float]:
    low, high = claim.band
    if claim.verdict == "overconfident":
        return 2, claim.ratio / high
    return (1, low / max(claim.ratio, 1e-300)) if claim.verdict == "cautious" else (0, 0.0)


def doubt_of(claims: tuple[Claim, ...]) -> str:
    """Where a claim does not hold, by how much; else nothing."""
    if not claims or claims[0].verdict != "overconfident":
        return ""
    claim = claims[0]
    where = {"test": "the error", "smoothed": "the smoothed error"}.get(claim.of, f"the RMS over {claim.draws} repeats")
    return f"{where} is {claim.ratio:.2g} times the claimed σ, at most {claim.band[1]:.3g} where the claim holds"
