"""Layouts within limits by an integer program, those that detect every unknown, and why no layout exists."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array, diags_array, vstack

from strainsight.errors import InfeasibleError
from strainsight.loads.observability import MarginalModes, least_gauges, undetectable_directions, undetectable_in_words
from strainsight.placement.limits import BUDGET, KEEP, SPACING, Limits
from strainsight.placement.scenario import Pool

SEES = 1e-9
"""A gauge responds to a direction if its answer exceeds this share of the largest one."""
NODES = 200
"""Nodes of a program whose answer must be proven: a limit of work, not of time, so that the result does not depend on the
machine."""


@dataclass(frozen=True)
class Found:
    """gauges (k,) ascending, None if none exist; bound: no layout is worth more; settled: whether the program ended within its
    nodes."""

    gauges: np.ndarray | None
    bound: float
    settled: bool


def best_layout(
    limits: Limits,
    value: np.ndarray,
    *,
    names: Collection[str] | None = None,
    allowed: np.ndarray | None = None,
    required: np.ndarray | None = None,
    floor: int = 0,
    hits: Sequence[np.ndarray] = (),
    sums: Sequence[tuple[np.ndarray, int]] = (),
    nodes: int = NODES,
    gap: float = 0.0,
) -> Found:
    """Layout with the largest Σ value·v, by an integer program.

        rows·v ≤ most for the limits of these names (all),   Σ size·v ≥ floor,
        Σ v over each of `hits` ≥ 1,   Σ a·v ≥ b for each (a, b) of `sums`

    value (pool,); allowed (pool,) bool: available rows; required (pool,) bool: rows that must be selected in addition to the
    fixed ones; hits: masks (pool,); sums: a (pool,) and b; nodes: most of the search; gap: permitted relative gap to the
    optimum."""
    count = len(limits.size)
    selected = np.array([names is None or name in names for name in limits.names])
    rows, most = limits.rows[selected], limits.most[selected]
    unit = 1 / np.maximum(rows.max(axis=1).toarray().ravel(), np.finfo(float).tiny)
    below, low = [csr_array(diags_array(unit) @ rows)], [np.full(len(most), -np.inf)]
    above = [most * unit]
    for mask, least in [(limits.size, float(floor)), *((hit, 1.0) for hit in hits), *sums]:
        below.append(csr_array(np.asarray(mask, dtype=float)[None, :]))
        low.append(np.array([least]))
        above.append(np.array([np.inf]))
    upper = np.ones(count) if allowed is None else np.asarray(allowed, dtype=float)
    lower = np.zeros(count)
    lower[list(limits.fixed)] = 1.0
    if required is not None:
        lower[required] = 1.0
    scale = max(float(np.abs(value).max()), np.finfo(float).tiny)
    priced = np.array([name == BUDGET for name in np.array(limits.names)[selected]], dtype=float)
    # the program holds its rows to 1e-6: where a sum of prices is over by that it is asked again, with so much less
    for spare in (0.0, 1e-5):
        above[0] = most * unit - spare * priced
        done = milp(
            -value / scale,
            integrality=np.ones(count, dtype=int),
            bounds=Bounds(np.minimum(lower, upper), upper),
            constraints=LinearConstraint(vstack(below, format="csr"), np.concatenate(low), np.concatenate(above)),
            options={"node_limit": nodes, "mip_rel_gap": gap},
        )
        bound = np.inf if done.get("mip_dual_bound") is None else -scale * float(done["mip_dual_bound"])
        if done.x is None:
            return Found(None, -np.inf if done.status == 2 else bound, done.status == 2)
        gauges = np.flatnonzero(done.x > 0.5)
        if np.all(limits.used(gauges)[selected] <= most):
            return Found(gauges, bound, done.status == 0)
    return Found(None, bound, False)


class Detection:
    """Unknowns that a set of gauges cannot detect, and masks of which each layout needs a gauge. hits: masks (pool,): a
    layout without a gauge of one of them loses an unknown; sums: channels (pool,) of each gauge, and the number that a layout
    needs at least, one per unknown. Without them all sets of too few gauges would be tried."""

    def __init__(self, pools: Sequence[Pool]):
        self.pools = pools
        self.hits: list[np.ndarray] = []
        self.sums = [(pool.channels, least_gauges(pool.modes)) for pool in pools]
        self._known: set[bytes] = set()

    def loses(self, gauges: np.ndarray) -> bool:
        """Whether this set loses an unknown; each lost direction becomes one of `hits`. F v = λ v, h_g v = 0 for all g of the
        set: a layout that detects v has a gauge with h_g v ≠ 0."""
        lost = False
        for pool in self.pools:
            rows, modes = pool.stacked(gauges), pool.modes
            for value, V in zip(modes.eigenvalue, modes.vectors, strict=True):
                directions = undetectable_directions(pool.scenario.F, rows, MarginalModes((value,), (V,), modes.scale))
                half = directions.shape[1] // 2
                vectors = directions[:, :half] + 1j * directions[:, half:] if complex(value).imag else directions
                for v in vectors.T:
                    answer = np.linalg.norm(pool.rows @ v, axis=1)
                    responding = answer > SEES * answer.max()
                    responding[gauges] = False
                    if responding.tobytes() not in self._known:
                        self._known.add(responding.tobytes())
                        self.hits.append(responding)
                    lost = True
        return lost

    def words(self, gauges: np.ndarray, names: Sequence[str]) -> str:
        """Names of the unknowns that a set loses."""
        for pool in self.pools:
            directions = undetectable_directions(pool.scenario.F, pool.stacked(gauges), pool.modes)
            if directions.shape[1]:
                return undetectable_in_words(directions, names)
        return "nothing"

    def layout(
        self,
        limits: Limits,
        value: np.ndarray,
        *,
        names: Collection[str] | None = None,
        floor: int = 0,
        nodes: int = NODES,
    ) -> Found:
        """`best_layout` of those that detect every unknown."""
        while True:
            layout = best_layout(limits, value, names=names, floor=floor, hits=self.hits, sums=self.sums, nodes=nodes)
            if layout.gauges is None or not self.loses(layout.gauges):
                return layout


def refusal(limits: Limits, detection: Detection, names: Sequence[str]) -> InfeasibleError:
    """Why no layout is within the limits: the first limit that excludes all, family by family. names: of the unknowns. The
    fixed gauges alone, then zones, spacing, budget and count; then the same with detection of every unknown."""
    fixed = np.array(sorted(limits.fixed), dtype=int)
    broken = np.flatnonzero(limits.used(fixed) > limits.most)
    if len(broken):
        return _conflict(limits, int(broken[0]))
    families = [*dict.fromkeys(n for n in limits.names if n not in (KEEP, SPACING, BUDGET))]
    families += [n for n in (SPACING, BUDGET) if n in limits.names]
    size = limits.size.astype(float)
    for i in range(len(families)):
        layout = best_layout(limits, size, names=[*families[: i + 1], KEEP])
        room = 0 if layout.gauges is None else int(limits.size[layout.gauges].sum())
        if room < limits.least:
            return _no_room(limits, families[: i + 1], room, layout)
    for i in range(len(families)):
        active = families[: i + 1]
        if detection.layout(limits, size, names=active).gauges is None:
            return _undetected(limits, detection, active, names)
    fewest = detection.layout(limits, -size, names=families)
    least = None if fewest.gauges is None else int(limits.size[fewest.gauges].sum())
    if least is not None and least > limits.keep:
        known = "" if fewest.settled else f" (not proven: the integer program stopped at its limit of {NODES} nodes)"
        return InfeasibleError(
            f"{limits.keep} gauges requested, but the smallest set that makes every unknown observable{_within(families)}"
            f"{known} has {least}",
            key=KEEP,
            remedy=f"keep at least {least} gauges (place.keep), or estimate fewer unknowns",
        )
    return InfeasibleError(
        f"no layout of {limits.keep} gauges that makes every unknown observable was found{_within(families)}",
        key=KEEP,
        remedy="change the number of gauges (place.keep), or relax the limits",
    )


def _conflict(limits: Limits, at: int) -> InfeasibleError:
    name, row = limits.names[at], limits.rows[[at]].toarray().ravel()
    bonded = [g for g in sorted(limits.fixed) if row[g] > 0]
    if name == SPACING:
        what = f"bonded gauges ({limits.key}) are closer to candidate gauge {bonded[0]} than {name} allows"
    else:
        unit = "" if name == BUDGET else " gauges"
        used = f"{row[bonded].sum():g}{unit} of the {limits.most[at]:g}"
        what = f"bonded gauges ({limits.key}) use {used} that {name} allows"
    return InfeasibleError(what, key=name, remedy=f"relax the limit {name}, or remove a gauge from {limits.key}")


def _no_room(limits: Limits, families: Sequence[str], room: int, layout: Found) -> InfeasibleError:
    name, before = families[-1], families[:-1]
    alone = best_layout(limits, limits.size.astype(float), names=[name, KEEP]) if before else layout
    enough = alone.gauges is not None and int(limits.size[alone.gauges].sum()) >= limits.least
    together = f" together with {' and '.join(before)}" if enough else ""
    surely = "" if layout.settled else f" (not proven: the integer program stopped at its limit of {NODES} nodes)"
    return InfeasibleError(
        f"{limits.keep} gauges requested, but {name}{together} allows only {room} of the {limits.size.sum()} candidate gauges"
        f"{surely}",
        key=name,
        remedy=f"set {KEEP}: {room}, or relax the limit {name}" if room else f"relax the limit {name}",
    )


def _undetected(limits: Limits, detection: Detection, active: Sequence[str], names: Sequence[str]) -> InfeasibleError:
    name, before = active[-1], active[:-1]
    if name == BUDGET:
        price = limits.rows[[limits.names.index(BUDGET)]].toarray().ravel()
        cheapest = detection.layout(limits, -price, names=before)
        if cheapest.gauges is not None:
            budget = limits.most[limits.names.index(BUDGET)]
            return InfeasibleError(
                f"the cheapest gauges that make every unknown observable{_within(before)} cost "
                f"{price[cheapest.gauges].sum():g}, but {name} is {budget:g}",
                key=name,
                remedy="increase the budget, or estimate fewer unknowns",
            )
    most = best_layout(limits, limits.size.astype(float), names=active)
    words = "an unknown" if most.gauges is None else detection.words(most.gauges, names)
    return InfeasibleError(
        f"no layout{_within(active)} can observe {words}",
        key=name,
        remedy=f"relax the limit {name}, or estimate fewer unknowns",
    )


def _within(names: Sequence[str]) -> str:
    return f" within {' and '.join(names)}" if names else ""
