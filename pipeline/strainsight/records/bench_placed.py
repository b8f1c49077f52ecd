"""place.h5 of a bench: candidates, the elimination in the pool, and the layouts with what each is expected to know."""

from __future__ import annotations

import numpy as np

from strainsight.records.record import dataset, group, record

PLACED = "place"
"""Name of the layout that was placed; others are drawn at random, random-1, random-2 …"""


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
    """place.h5 of a bench, what its pages and sensors read."""

    inputs: tuple[str, ...] = dataset("/inputs", "1", "/inputs", "name of every unknown input")
    pool: np.ndarray = dataset("/pool/candidate", "1", "pool", "candidates that enter the elimination")
    position: np.ndarray = dataset("/candidates/position", "m", "candidate × 3", "position")
    removed: np.ndarray = dataset("/elimination/removed", "1", "step", "pool rows in the order of their removal")
    trace: np.ndarray = dataset("/elimination/trace", "1", "step + 1", "tr(W P), the full pool first")
    layouts: dict[str, BenchLayout] = group("/layouts/<name>")

    def layout(self, which: str) -> BenchLayout:
        """For a sensor with `layout: which`. "random": the first of those drawn, which is no worse a draw than another."""
        return self.layouts[PLACED if which == PLACED else "random-1"]
