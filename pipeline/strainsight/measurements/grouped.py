"""Channels in groups: found by name, and all on one clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strainsight.errors import UserError, did_you_mean
from strainsight.measurements.records import plain

SAME_RATE = 1e-6
"""Share by which rates of one clock may differ, and share of a step by which its time stamps may."""


class Place(NamedTuple):
    """Where a channel is: group and name, and the number of its group, from 0."""

    group: str
    name: str
    number: int

    @property
    def names(self) -> tuple[str, ...]:
        """What it may be asked for by: "G1", "rig/G1", "0/G1"."""
        longer = (f"{self.group}/{self.name}",) if self.group else ()
        return (self.name, *longer, f"{self.number}/{self.name}")


def chosen(name: str, places: Sequence[Place], path: Path) -> int:
    """Which of the places a name means: that of a channel alone, where one has it, or with its group in front.

    Raises UserError where there is none, or several.
    """
    for length in range(3):
        found = [i for i, place in enumerate(places) if name in place.names[length : length + 1]]
        if len(found) == 1:
            return found[0]
        if found:
            groups = [places[i].group for i in found]
            alone = [g and groups.count(g) == 1 for g in groups]
            said = [places[i].names[1 if one else -1] for i, one in zip(found[:10], alone, strict=False)]
            raise UserError(
                f"{len(found)} channels are called {name!r}",
                where=str(path),
                remedy=f"name the group too: {' or '.join(map(plain, said))}{' …' if len(found) > 10 else ''}",
            )
    known = list(dict.fromkeys(word for place in places for word in place.names[:2]))
    said = list(dict.fromkeys(plain(place.names[0]) for place in places))
    raise UserError(
        f"no channel {name!r}",
        where=str(path),
        remedy=did_you_mean(
            name, known, f"it has {', '.join(said[:20])}{' …' if len(said) > 20 else ''}" if said else "it has none"
        ),
    )


def check_one_clock(clocks: Mapping[str, np.ndarray], path: Path) -> None:
    """Raise UserError unless all channels, name → times (T,) [s], have one and the same time."""
    first, *others = clocks.values()
    if all(_same(first, other) for other in others):
        return
    rates: list[tuple[float, list[str]]] = []
    for name, t in clocks.items():
        rate = (len(t) - 1) / (t[-1] - t[0]) if len(t) > 1 and t[-1] > t[0] else 0.0
        like = next((names for known, names in rates if abs(known - rate) <= SAME_RATE * abs(rate)), None)
        if like is None:
            rates.append((rate, [name]))
        else:
            like.append(name)
    if len(rates) > 1:
        said = ", ".join(
            f"{rate:.6g} Hz ({', '.join(map(plain, names[:8]))}{', …' * (len(names) > 8)})" for rate, names in rates
        )
        raise UserError(
            f"the channels have {len(rates)} sampling rates: {said}",
            where=str(path),
            remedy="take channels of one rate, or export the record with all of them resampled to one",
        )
    name, t = next((name, t) for name, t in clocks.items() if not _same(first, t))
    two = {next(iter(clocks)): first, name: t}
    spans = [f"{plain(n)} has {len(x)} samples from {_at(x, 0)} to {_at(x, -1)} s" for n, x in two.items()]
    raise UserError(
        ", ".join(spans),
        where=str(path),
        remedy="take channels of one clock, or export the record with all of them cut and resampled to one",
    )


def _same(t: np.ndarray, other: np.ndarray) -> bool:
    if t is other:
        return True
    if t.shape != other.shape:
        return False
    return not t.size or bool(np.allclose(t, other, rtol=0, atol=SAME_RATE * abs(t[-1] - t[0]) / t.size))


def _at(t: np.ndarray, index: int) -> str:
    return f"{t[index]:g}" if len(t) else "nowhere"


def numbers(values: np.ndarray, name: str, where: str) -> np.ndarray:
    """The samples of a channel as numbers (T,). Raises UserError where they are none, or infinite."""
    if values.dtype.kind not in "iuf" or values.ndim != 1:
        held = {"O": "text or objects", "S": "text", "U": "text", "M": "times of the day"}.get(values.dtype.kind)
        said = held or (
            f"values of the shape {values.shape[1:]} each" if values.ndim != 1 else f"values of type {values.dtype}"
        )
        raise UserError(
            f"{name!r} holds {said}, not numbers", where=where, remedy="take a channel with one real number a sample"
        )
    found = values.astype(float)
    if np.isinf(found).any():
        sample = int(np.argmax(np.isinf(found)))
        raise UserError(
            f"sample {sample + 1} of {name!r} is infinite", where=where, remedy="write NaN where the sample is missing"
        )
    return found


def one_unit(stated: Sequence[str], name: str, where: str) -> str | None:
    """The unit that a channel states, None where it states none. Raises UserError where it states several."""
    words = sorted({word.strip() for word in stated} - {""})
    if len(words) > 1:
        raise UserError(
            f"{name!r} states the units {' and '.join(map(plain, words))}", where=where, remedy="leave the right one"
        )
    return words[0] if words else None
