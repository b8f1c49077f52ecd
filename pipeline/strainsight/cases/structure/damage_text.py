"""Damage in a test for people: numbers by name, a sentence, tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.records.damage import DamageAt, Damaged
from strainsight.workflow.output import Scalar, Table


def damage_numbers(found: Damaged | None, labels: Sequence[str]) -> dict[str, Scalar]:
    """Damage, interval, equivalent range [Pa] and life [h] of the worst point and of every virtual gauge."""
    if found is None:
        return {}
    numbers: dict[str, Scalar] = {}
    for name, at, i in _places(found, labels):
        level = at.damage[i] if np.isfinite(at.damage[i]) else at.of_mean[i]
        numbers[f"damage.of_mean.{name}"] = float(at.of_mean[i])
        if not np.isnan(at.damage[i]):
            numbers |= {
                f"damage.{name}": float(at.damage[i]),
                f"damage.low.{name}": float(at.low[i]),
                f"damage.high.{name}": float(at.high[i]),
                f"equivalent_range.{name}": float(at.range[i]),
            }
        if level > 0:
            numbers[f"life.{name}"] = float(found.hours / level)
    return numbers


def damage_in_words(found: Damaged | None) -> list[str]:
    """The worst point of the surface."""
    if found is None or found.surface is None or found.hot_spot is None or not len(found.hot_spot):
        return []
    at, i = found.surface, int(found.hot_spot[0])
    return [f"damage up to {_damage(at, i)}{_interval(at, i, ' (', ')')} at element {at.element[i]}"]


def damage_tables(found: Damaged | None, labels: Sequence[str]) -> tuple[Table, ...]:
    """Hot spots of the surface, then the virtual gauges."""
    if found is None:
        return ()
    withheld = all(np.isnan(at.damage).all() for _, at, _ in _places(found, labels))
    rows = []
    if found.surface is not None and found.hot_spot is not None:
        for number, i in enumerate(found.hot_spot.tolist(), start=1):
            rows.append((f"{number}, element {found.surface.element[i]}", *_row(found, found.surface, i)))
    if found.virtual is not None:
        rows += [(label, *_row(found, found.virtual, i)) for i, label in enumerate(labels)]
    columns = ("place", "x, y, z [m]", "damage", "95 %", "equivalent range", "life")
    title = "damage of the smoothed history, interval withheld" if withheld else "damage: hot spots and virtual gauges"
    return (Table(title, columns, tuple(rows)),)


def _places(found: Damaged, labels: Sequence[str]) -> list[tuple[str, DamageAt, int]]:
    places: list[tuple[str, DamageAt, int]] = []
    if found.surface is not None and found.hot_spot is not None and len(found.hot_spot):
        places.append(("surface", found.surface, int(found.hot_spot[0])))
    if found.virtual is not None:
        places += [(label, found.virtual, i) for i, label in enumerate(labels)]
    return places


def _row(found: Damaged, at: DamageAt, i: int) -> tuple[str, ...]:
    where = ", ".join(f"{value:.4g}" for value in at.position[i])
    drawn = not np.isnan(at.damage[i])
    level, range_ = (at.damage[i], at.range[i]) if drawn else (at.of_mean[i], at.range_of_mean[i])
    life = f"{found.hours / level:.3g} h" if level > 0 else "no damage"
    if drawn and at.high[i] > 0:
        longest = f"{found.hours / at.low[i]:.2g}" if at.low[i] > 0 else "∞"
        life += f" ({found.hours / at.high[i]:.2g} to {longest})"
    return where, _damage(at, i), _interval(at, i) or "withheld", f"{range_ / 1e6:.4g} MPa", life


def _damage(at: DamageAt, i: int) -> str:
    return f"{at.of_mean[i] if np.isnan(at.damage[i]) else at.damage[i]:.3g}"


def _interval(at: DamageAt, i: int, before: str = "", after: str = "") -> str:
    return "" if np.isnan(at.damage[i]) else f"{before}{at.low[i]:.2g} to {at.high[i]:.2g}{after}"
