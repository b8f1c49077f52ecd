"""Parameters that have left the range which a reduced model was made for, of structures and benches."""

from __future__ import annotations

from collections.abc import Mapping


def beyond_their_ranges(
    values: Mapping[str, float], ranges: Mapping[str, tuple[float, float]], units: Mapping[str, str], stage: str
) -> dict[str, str]:
    """Parameter → that its value lies beyond its range, for those that do; ranges: of those that the model is not exact in [SI];
    stage: which has made the model."""
    found = {}
    for name, (low, high) in ranges.items():
        if not low <= values[name] <= high:
            unit = "" if units[name] == "1" else f" {units[name]}"
            found[name] = (
                f"{name} came out at {values[name]:.4g}{unit}, and {stage} made the model for {low:.4g} to {high:.4g}"
            )
    return found


def withheld_beyond(beyond: Mapping[str, str], remedy: str) -> str:
    """That there is no σ, and why; empty where nothing lies beyond its range. What the model is off by there is in no σ."""
    return f"σ is withheld: {'; '.join(beyond.values())}: {remedy}" if beyond else ""
