"""One thing to correct in a config."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from strainsight.errors import did_you_mean


@dataclass(frozen=True)
class Problem:
    """One thing to correct: dotted key, what is wrong, the remedy; whether the key itself is wrong, not its value."""

    key: str
    what: str
    remedy: str = ""
    at_key: bool = False


def shown_key(key: str) -> str:
    """A dotted key as it is printed: `loads.0.node` is loads[0].node."""
    return re.sub(r"\.(\d+)(?=\.|$)", r"[\1]", key)


def exactly_one(key: str, values: Mapping[str, object]) -> Iterator[Problem]:
    """A problem unless exactly one of the values is given."""
    given = [f"'{name}'" for name, value in values.items() if value is not None]
    if len(given) != 1:
        listed = [f"'{name}'" for name in values]
        what = f"{' and '.join(given)} are both given" if given else f"none of {', '.join(listed)} is given"
        yield Problem(key, what, f"give exactly one of {', '.join(listed)}", at_key=True)


def undivided(key: str, duration: float, step: float, other: str = "") -> Iterator[Problem]:
    """A problem unless the duration [s] is a whole number of steps [s]; other: key of the duration, where it may change too."""
    steps = duration / step
    if abs(steps - round(steps)) > 1e-6 * steps:
        what = f"{step:g} s does not divide the duration of {duration:g} s ({steps:.6g} steps)"
        longer = f", or {other}: {step * round(steps):.9g}" if other else ""
        yield Problem(key, what, f"take {duration / round(steps):.9g} s{longer}")


def known(key: str, name: str, names: Collection[str], what: str) -> Iterator[Problem]:
    """A problem unless the name is one of these."""
    if name not in names:
        listed = ", ".join(names) or "none"
        yield Problem(key, f"no {what} '{name}'", did_you_mean(name, names, f"known here: {listed}"))
