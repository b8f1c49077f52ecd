"""One thing to mend in a config."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Problem:
    """One thing to mend: dotted key, what is wrong, how to mend it; whether the key itself is wrong, not its value."""

    key: str
    what: str
    remedy: str = ""
    at_key: bool = False


def exactly_one(key: str, values: Mapping[str, object]) -> Iterator[Problem]:
    """A problem unless exactly one of the values is given."""
    given = [f"'{name}'" for name, value in values.items() if value is not None]
    if len(given) != 1:
        listed = [f"'{name}'" for name in values]
        what = f"{' and '.join(given)} are both given" if given else f"none of {', '.join(listed)} is given"
        yield Problem(key, what, f"give exactly one of {', '.join(listed)}", at_key=True)
