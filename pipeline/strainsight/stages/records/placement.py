"""What place writes: the scenarios as solved, the selections, the certificate, and the table of gauges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from strainsight.augmentation.observability import Observability
from strainsight.placement.certificate import Certificate
from strainsight.placement.elimination import Elimination
from strainsight.placement.recommendation import gains, worth_keeping
from strainsight.stages.case.problem import Problem
from strainsight.stages.records.grids import gauge_grid
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.output import Dataset, Table


def augmented_datasets(result: Elimination) -> dict[str, Dataset]:
    """Every scenario exactly as it was solved, so that anyone can solve it again."""
    s = [pool.scenario for pool in result.pools]
    return {
        "/augmented/F": Dataset(np.array([x.F for x in s]), "1/s", "augmented state matrix F* (scenario × n* × n*)"),
        "/augmented/H": Dataset(np.array([x.H for x in s]), "strain", "gauge rows H* (scenario × pool × n*)"),
        "/augmented/Q": Dataset(np.array([x.Q for x in s]), "1/s", "process intensity (scenario × n* × n*)"),
        "/augmented/R": Dataset(np.array([x.r for x in s]), "strain^2 s", "gauge intensity (scenario × pool)"),
        "/augmented/weight": Dataset(np.array([x.weight for x in s]), "1", "diagonal of W (scenario × n*)"),
        "/augmented/scale": Dataset(
            np.array([pool.scale for pool in result.pools]),
            "x*",
            "x* = scale · the coordinates above, in which diag P = 1 with the whole pool",
        ),
    }


def selection_datasets(key: str, gauges: np.ndarray, candidate: np.ndarray, train: Artefact) -> dict[str, Dataset]:
    chosen = candidate[gauges]
    place = f"/selected/{key}"
    return {
        f"{place}/gauge": Dataset(
            gauges, "1", "pool rows, the most missed gauge first" if key == "final" else "pool rows"
        ),
        f"{place}/rank": Dataset(
            np.arange(1, len(gauges) + 1),
            "1",
            "1 is the gauge that is missed most" if key == "final" else "order of the list",
        ),
        f"{place}/element": Dataset(train["/gauges/element"][chosen], "1", "element id in the deck"),
        f"{place}/facet": Dataset(train["/gauges/facet"][chosen], "1", "facet number within the element, from 1"),
        f"{place}/nodes": Dataset(
            train["/gauges/nodes"][chosen], "1", "node indices of the facet, −1 where it has fewer"
        ),
        f"{place}/position": Dataset(train["/gauges/position"][chosen], "m", "facet centre (gauge × xyz)"),
        f"{place}/direction": Dataset(train["/gauges/direction"][chosen], "1", "measuring direction (gauge × xyz)"),
    }


def expected_dataset(problem: Problem, name: str, std: Mapping[str, float]) -> Dataset:
    scale = dict(zip(problem.unknowns.names, problem.unknowns.scale.tolist(), strict=True))[name]
    return Dataset(
        np.array(std[name] * scale), "SI", f"σ of {name} that the filter is expected to claim, along the training run"
    )


def certificate_datasets(certificate: Certificate | None) -> dict[str, Dataset]:
    if certificate is None:
        return {}
    return {
        "/certificate/lower_bound": Dataset(
            np.array(certificate.lower_bound), "1", "no set of this size has a smaller tr(W P)"
        ),
        "/certificate/gap": Dataset(np.array(certificate.gap), "1", "(tr(W P) of the final set − bound) / tr(W P)"),
        "/certificate/weights": Dataset(certificate.weights, "1", "gauge weights of the relaxed problem"),
    }


def place_message(
    pool: int, keep: int, certificate: Certificate | None, std: Mapping[str, float], condition: Observability
) -> str:
    parts = [f"{pool} → {keep}"]
    if certificate:
        parts.append(f"gap {100 * max(certificate.gap, 0.0):.3f} %")
    parts += [f"{name} ± {100 * value:.2g} %" for name, value in std.items()]
    if condition.null_direction:
        parts.append(f"hardly observable: {condition.null_direction}")
    return ", ".join(parts)


def gauge_table(final: np.ndarray, candidate: np.ndarray, train: Artefact, without: Mapping[str, np.ndarray]) -> Table:
    chosen = candidate[final]
    element, facet, angle = (train[f"/gauges/{key}"][chosen] for key in ("element", "facet", "angle"))
    position, direction = train["/gauges/position"][chosen], train["/gauges/direction"][chosen]
    rows = tuple(
        (
            f"G{i + 1}",
            str(element[i]),
            str(facet[i]),
            " ".join(f"{x:.4f}" for x in position[i]),
            " ".join(f"{round(x, 3) + 0.0:g}" for x in direction[i]),
            f"{angle[i]:g}°",
            *(f"{100 * values[i]:.3g} %" for values in without.values()),
        )
        for i in range(len(chosen))
    )
    columns = (
        "gauge",
        "element",
        "facet",
        "x y z [m]",
        "direction",
        "angle",
        *(f"σ({name}) without it" for name in without),
    )
    return Table("gauges", columns, rows)


def gauge_csv(final: np.ndarray, candidate: np.ndarray, train: Artefact, without: Mapping[str, np.ndarray]) -> bytes:
    """The layout for whoever glues it: a line a gauge, lengths in m, σ of every unknown without it relative to its scale."""
    chosen = candidate[final]
    element, facet, angle = (train[f"/gauges/{key}"][chosen] for key in ("element", "facet", "angle"))
    vectors = np.hstack([train[f"/gauges/{key}"][chosen] for key in ("position", "normal", "direction")])
    head = ["gauge", "element", "facet", *(f"{v}_{axis}" for v in ("position", "normal", "direction") for axis in "xyz")]
    lines = [",".join([*head, "angle_deg", *(f"std_{name}_without" for name in without)])]
    for i in range(len(chosen)):
        numbers = [*vectors[i], angle[i], *(values[i] for values in without.values())]
        lines.append(",".join([f"G{i + 1}", str(element[i]), str(facet[i]), *(f"{x:.9g}" for x in numbers)]))
    return ("\n".join(lines) + "\n").encode()


def advice_table(trace: np.ndarray, keep: int, groups: Sequence[tuple[int, ...]]) -> Table:
    """How many gauges are worth it, and which of the layout read alike."""
    worth, gain = worth_keeping(trace, keep), gains(trace)
    rows = []
    if len(gain):
        rows.append((f"gauge {keep + 1}", f"would lower σ by {100 * gain[0]:.2g} %"))
    further = "as many as asked for" if worth == keep else f"{worth}"
    rows.append(("gauges worth it", f"{further}: each further one lowers σ by less than 5 %"))
    rows += [
        (", ".join(f"G{i + 1}" for i in group), "read alike in the training run: they average noise, and stand in for each other")
        for group in groups
    ]
    return Table("advice", ("", ""), tuple(rows))


def placed_grid(
    final: np.ndarray, removed: np.ndarray, candidate: np.ndarray, train: Artefact
) -> tuple[dict[str, Dataset], dict[str, dict[str, Any]]]:
    """The pool as points: rank in the final set (0: not in it), step at which a gauge was removed (0: never), direction."""
    rank, step = np.zeros(len(candidate), dtype=np.int64), np.zeros(len(candidate), dtype=np.int64)
    rank[final] = np.arange(1, len(final) + 1)
    step[removed] = np.arange(1, len(removed) + 1)
    return gauge_grid(
        train["/gauges/position"][candidate],
        {"rank": rank, "removed": step, "direction": train["/gauges/direction"][candidate]},
    )
