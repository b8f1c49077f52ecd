"""place.h5 of a bench: candidates, the elimination in the pool, and the layouts with what each is expected to know."""

from __future__ import annotations

import numpy as np

from strainsight.records.record import dataset, group, record

PLACED = "place"
"""Name of the layout that was placed; others are drawn at random, random-1, random-2 …"""


@record
class BenchCandidates:
    position: np.ndarray = dataset("/position", "m", "candidate × 3", "position")
    direction: np.ndarray = dataset("/direction", "1", "candidate × 3", "measuring direction")
    element: np.ndarray = dataset("/element", "1", "candidate", "element id in the deck")
    facet: np.ndarray = dataset("/facet", "1", "candidate", "facet number within the element, from 1")
    response: np.ndarray = dataset(
        "/response", "strain/N or strain/(N m)", "candidate × /inputs", "strain per unit of every input at rest"
    )


@record
class AugmentedBench:
    """State (y, ẏ, u) about the static equilibrium: motions that the constraints leave, their rates, the unknown inputs."""

    F: np.ndarray = dataset("/F", "1/s", "n* × n*", "state matrix of (η, η̇, u) about the static equilibrium")
    H: np.ndarray = dataset("/H", "strain", "pool × n*", "row of every gauge of the pool")
    Q: np.ndarray = dataset("/Q", "1/s", "n* × n*", "process intensity")
    R: np.ndarray = dataset("/R", "strain^2 s", "pool", "intensity of every gauge")
    weight: np.ndarray = dataset("/weight", "1", "n*", "diagonal of W")


@record
class BenchElimination:
    removed: np.ndarray = dataset("/removed", "1", "step", "pool rows in the order of their removal")
    trace: np.ndarray = dataset("/trace", "1", "step + 1", "tr(W P), the full pool first")
    rise: np.ndarray = dataset("/rise", "1", "step", "rise of tr(W P) at every removal, with all its digits")
    greedy: np.ndarray = dataset("/greedy", "1", "kept", "pool rows that the elimination leaves")


@record
class BenchCertificate:
    lower_bound: float = dataset("/lower_bound", "1", "", "no layout of that size has a lower tr(W P)")
    gap: float = dataset("/gap", "1", "", "(tr(W P) of the layout − lower bound) / tr(W P)")
    weights: np.ndarray = dataset("/weights", "1", "pool", "weights of the relaxation")


@record
class BenchLayout:
    """One layout, its gauges in its order."""

    candidate: np.ndarray = dataset("/candidate", "1", "gauge", "number of every gauge among the candidates")
    position: np.ndarray = dataset("/position", "m", "gauge × 3", "position")
    direction: np.ndarray = dataset("/direction", "1", "gauge × 3", "measuring direction")
    trace: float = dataset(
        "/trace", "1", "", "tr(W P); inf where an input is lost, NaN where the equation is not solved to accuracy"
    )
    std: np.ndarray = dataset(
        "/std",
        "N or N m",
        "/inputs",
        "σ of every input that a filter on implicit Euler comes to claim; inf where it is lost, NaN where that is not solved",
    )
    without: np.ndarray = dataset("/without", "N or N m", "gauge × /inputs", "that σ without each gauge")


@record
class BenchPlaced:
    """place.h5 of a bench."""

    inputs: tuple[str, ...] = dataset("/inputs", "1", "/inputs", "name of every unknown input")
    units: tuple[str, ...] = dataset("/units", "1", "/inputs", "unit of every one of them")
    candidates: BenchCandidates = group("/candidates")
    augmented: AugmentedBench = group("/augmented")
    pool: np.ndarray = dataset("/pool/candidate", "1", "pool", "candidates that enter the elimination")
    elimination: BenchElimination = group("/elimination")
    exchange: np.ndarray = dataset(
        "/exchange/trace", "1", "exchange + 1", "tr(W P) after every exchange, the elimination's first"
    )
    certificate: BenchCertificate = group("/certificate")
    layouts: dict[str, BenchLayout] = group("/layouts/<name>")

    def layout(self, which: str) -> BenchLayout:
        """For a sensor with `layout: which`. "random": the first of those drawn, which is no worse a draw than another."""
        return self.layouts[PLACED if which == PLACED else "random-1"]
