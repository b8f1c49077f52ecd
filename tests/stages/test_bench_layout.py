"""The layout of a bench by every criterion and within its limits: scipy's Riccati solver over all that are allowed."""

from __future__ import annotations

from functools import cache
from itertools import chain, combinations

import numpy as np
import pytest
from scipy.linalg import LinAlgError, solve_continuous_are

from strainsight.errors import StrainsightError

from .test_bench_place import PLACED, run

INCREMENT = np.array([20.0, 10.0])
"""Of the two loads of that beam [N]."""
BONDED = "place.fixed=[{position: [0.3, 0.0, 0.095], direction: [1, 0, 0]}]"
SPREAD = ("place.pool=10", "place.spacing=0.4")
CLAMPED = "place.at_most=[{zone: {box: [[-1, -1, -1], [0.35, 1, 1]]}, count: 1}]"


def place(*changes, last="place"):
    """place.h5 of the beam with seven candidates in the pool."""
    return run("place.random=1", "place.pool=7", *changes, only=(*PLACED, last))[last]


@cache
def filter_of(place):
    """F, Hᵀ whitened, Q, and the scale of the two loads."""
    F, H, Q, R, scale = (place[f"/augmented/{name}"][0] for name in ("F", "H", "Q", "R", "scale"))
    return F, H / np.sqrt(R)[:, None], Q, scale[-2:]


@cache
def covariance(place, gauges):
    """Of the two loads [N²] with these pool rows; None where scipy finds no steady one."""
    F, H, Q, scale = filter_of(place)
    try:
        P = solve_continuous_are(F.T, H[list(gauges)].T, Q, np.eye(len(gauges)))
    except LinAlgError:
        return None
    return P[-2:, -2:] * np.outer(scale, scale)


def weights(place):
    """Of the trace: the whole pool counts 1 an unknown."""
    return 1 / np.diag(covariance(place, tuple(range(len(filter_of(place)[1])))))


def value(criterion, place, gauges):
    M = covariance(place, tuple(sorted(gauges))) if len(gauges) > 1 else None
    if M is None:
        return np.inf
    relative = M / np.outer(INCREMENT, INCREMENT)
    return {
        "trace": lambda: weights(place) @ np.diag(M),
        "down": lambda: M[1, 1] * weights(place)[1],
        "log_determinant": lambda: np.sqrt(np.linalg.det(relative)),
        "worst_eigenvalue": lambda: np.linalg.eigvalsh(relative)[-1],
    }[criterion]()


def best(place, criterion, sizes, allowed=lambda gauges: True):
    every = chain.from_iterable(combinations(range(len(place["/pool/candidate"])), size) for size in sizes)
    return min(value(criterion, place, gauges) for gauges in every if allowed(gauges))


def proven(place, criterion, sizes, allowed=lambda gauges: True):
    """That the layout is allowed, costs what scipy says, and that no other one costs less."""
    final = tuple(sorted(place["/selected/final/gauge"].tolist()))
    key = "trace" if place.summary["criterion"] == "trace" else "metric"
    least = best(place, criterion, sizes, allowed)
    assert allowed(final)
    assert len(final) in sizes
    assert place.summary["proven"]
    assert place.summary[f"{key}_final"] == pytest.approx(value(criterion, place, final), rel=1e-6)
    assert place.summary[f"{key}_final"] == pytest.approx(least, rel=2e-6)
    assert place.summary["lower_bound"] <= least * (1 + 1e-6)


@pytest.mark.parametrize("criterion", ["trace", "log_determinant"])
def test_the_layout_is_proven_best_by_every_criterion(criterion):
    """Each criterion chooses by its own number, and lists all of them; the trace is over one load."""
    found = place("place.prove=60", f"place.criterion={criterion}", *["place.metric_over=[down]"] * (criterion == "trace"))
    proven(found, "down" if criterion == "trace" else criterion, [3])
    if criterion == "trace":
        return
    names, final = found["/criteria/name"].tolist(), found["/criteria/gauges"][0]
    assert names[0] == criterion
    expected = [value(name, found, final) for name in names]
    np.testing.assert_allclose(found["/criteria/value"][0], expected, rtol=1e-6)


def test_spacing_and_zones_hold_and_the_layout_is_the_best_within_them():
    found = place("place.prove=60", *SPREAD, "place.minimum_spacing=0.45", CLAMPED)
    x = found["/candidates/position"][found["/pool/candidate"]]
    apart = np.linalg.norm(x[:, None] - x[None], axis=2)

    def allowed(gauges):
        return sum(x[g, 0] <= 0.35 for g in gauges) <= 1 and all(apart[a, b] >= 0.45 for a, b in combinations(gauges, 2))

    proven(found, "trace", [3], allowed)
    free = place("place.prove=60", *SPREAD)
    assert not allowed(free["/selected/final/gauge"].tolist())


def test_a_budget_is_kept_and_the_gauge_that_is_there_costs_nothing_and_stays():
    found = place("place.prove=60", "place.keep=4", "place.budget=6", "place.price=2.5", BONDED)
    bonded = int(np.flatnonzero(found["/pool/candidate"] == 0)[0])
    np.testing.assert_allclose(found["/candidates/position"][0], [0.3, 0.0, 0.095], atol=1e-6)
    proven(found, "trace", [1, 2, 3], lambda gauges: bonded in gauges)
    assert found["/layouts/random-1/candidate"][0] == 0
    assert "costs 5; the budget is 6" in " ".join(found["/advice"])
    lines = (found.path.parent / "gauges.csv").read_text(encoding="utf-8").splitlines()
    head = lines[0].split(",")
    assert sorted(line.split(",")[head.index("glued")] for line in lines[1:]) == ["no", "no", "yes"]


def test_a_sensor_reads_the_bonded_gauge_over_its_grid():
    """Statics under the constant loads of the beam: a grid of 0.2 m averages the strain that falls along the beam."""
    grid = BONDED.replace("direction: [1, 0, 0]", "direction: [1, 0, 0], length: 0.2")
    found, simulated = place(grid), place(grid, last="simulate")
    own = found["/layouts/place/candidate"]
    assert found["/layouts/place/length"][own == 0] == pytest.approx(0.2)
    expected = found["/candidates/response"][own] @ [1000.0, 500.0]
    np.testing.assert_allclose(simulated["/sensors/gauges"][0], expected, rtol=1e-6)


def test_the_robust_layout_loses_least_in_its_worst_failure():

    def worst(gauges):
        return max(value("trace", found, [g for g in gauges if g != out]) for out in gauges)

    found = place("place.optimise=worst_failure", "place.certificate=false")
    final = found["/selected/final/gauge"].tolist()
    least = min(worst(gauges) for gauges in combinations(range(len(found["/pool/candidate"])), 3))
    assert worst(final) == pytest.approx(least, rel=1e-6)
    expected = [value("trace", found, [g for g in final if g != out]) for out in final]
    np.testing.assert_allclose(found["/failure/loss"], expected, rtol=1e-6)
    assert found.summary["worst_failure"] == pytest.approx(max(expected), rel=1e-6)
    assert not any(name.startswith("/certificate") for name in found.paths())


@pytest.mark.parametrize(
    ("changes", "key", "says"),
    [
        (("place.metric_over=[dwn]",), "place.metric_over[0]", "no entry of estimate.inputs has the name"),
        (("place.prove=1", "place.optimise=worst_failure"), "place.prove", "not for worst_failure"),
        (("place.keep=1", BONDED.replace("direction: [1, 0, 0]", "direction: [1, 0, 0], angles: [0, 90]")),
         "place.keep", "2 gauges are already bonded"),
        (("place.exclude=[{box: [[1, 1, 1], [0, 2, 2]]}]",), "place.exclude[0].box",
         "has to be smaller than that of the second corner"),
        ((BONDED.replace("0.3,", "0.1,"), CLAMPED.replace("count: 1", "count: 0")), "place.at_most.0", "place.fixed"),
        ((BONDED.replace("0.095", "0.195"),), "place.fixed.0", "snap_tolerance"),
    ],
)  # fmt: skip
def test_limits_and_bonded_gauges_that_cannot_be_are_refused_with_their_key(changes, key, says):
    with pytest.raises(StrainsightError) as refused:
        place(*changes)
    assert key in f"{refused.value} {refused.value.key}"
    assert says in str(refused.value)


NARROW = ("place.include=[{box: [[0.0, 0.03, 0.09], [0.65, 0.13, 0.1]]}]", "place.spacing=0.15", "place.pool=3", "place.keep=3")
"""A strip on top of the beam, aside of its middle: few enough candidates for all triples of them."""


def test_a_pool_of_few_ends_with_the_best_of_all_candidates():
    """Every triple of all candidates by scipy; the screened pool alone misses it; what is said of those left out is true."""
    every = place(*NARROW, "place.pool=1000", "place.spacing=0")
    number, alone = every["/pool/candidate"], place(*NARROW)

    def variances(gauges):
        P = covariance(every, gauges)
        return np.full(2, np.inf) if P is None else np.diag(P)

    whole = variances(tuple(range(len(number))))
    costs = {three: float(np.sum(variances(three) / whole)) for three in combinations(range(len(number)), 3)}
    best = min(costs.values())
    assert costs[tuple(np.sort(alone["/selected/final/number"]).tolist())] > best * 1.01
    found = place(*NARROW, "place.search=all", "place.prove=60")
    assert found.summary["bounded"] == len(number) > len(found["/pool/candidate"])
    assert found.summary["trace_final"] == pytest.approx(best, rel=1e-6)
    assert best * (1 - 1e-5) <= found.summary["lower_bound"] <= best * (1 + 1e-9)
    assert found.summary["beyond"] == 0
    assert found.summary["proven"]
    assert f"all {len(number)} candidates" in " ".join(found["/advice"])
