"""A small placement report for the tests: a clamped box of quad8 facets with four gauges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from strainsight.config.placement import Report
from strainsight.estimation.decision import Claim
from strainsight.pages.arrays import History, Reading
from strainsight.pages.picture.layout import Gauge, LoadArrow, PictureLayout
from strainsight.pages.placement.data import (
    Check,
    Criteria,
    MetricWords,
    Noise,
    ObservabilityCase,
    PlacementReport,
    RandomSetErrors,
    Repeats,
    Trend,
    Unknown,
)
from strainsight.pages.suite.data import PlacementRun, Suite
from strainsight.records.estimated import Posterior
from strainsight.records.placed import FrequencyResponse

ONE, TWENTY = (0.00169, 3.21), (0.555, 1.49)
"""Bands of one draw and of twenty."""
HELD = Claim("test", 1, 0.000523 / 0.000814, ONE, "consistent")
BUDGET = {
    "tip": {"noise": 0.52, "process noise": 0.25, "start": 0.0, "gain": 0.23},
    "E": {"noise": 0.06, "process noise": 0.14, "start": 1e-9, "gain": 0.8},
}
METRICS = (
    MetricWords("tr(W P)", "sum of the variances"),
    MetricWords("det(P)^(1/n)", "volume of the ellipsoid"),
    MetricWords("λ₁(P)", "variance of the worst"),
)


def box(cells=(10, 2, 3), size=(2.0, 0.08, 0.12)):
    """Points (n, 3) [m] and quad8 facets (f, 8), outward, of a box with one corner at the origin."""
    index: dict[tuple[int, ...], int] = {}

    def node(step):
        return index.setdefault(tuple(int(i) for i in step), len(index))

    faces = []
    for axis in range(3):
        u, v = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        for end in (0, 1):
            first, second = (u, v) if end else (v, u)
            a, b = int(np.argmax(first)), int(np.argmax(second))
            for i in range(cells[a]):
                for j in range(cells[b]):
                    corner = 2 * i * first + 2 * j * second + 2 * end * cells[axis] * np.eye(3, dtype=int)[axis]
                    steps = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
                    faces.append([node(corner + s * first + t * second) for s, t in steps])
    points = np.array(list(index)) * np.array(size) / (2 * np.array(cells))
    return points, np.array(faces)


@pytest.fixture
def beam():
    return layout()


def layout():
    points, faces = box()
    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    places = ((0.1, 0.12, z), (0.3, 0.12, z), (0.1, 0.0, -z), (0.5, 0.0, -z))
    gauges = tuple(
        Gauge(f"G{i}", 1200 + i, 3, np.array([along, 0.02, height]), x, normal, 0.0, {"E": 0.001 * i}, (41, 77, 52, 40))
        for i, (along, height, normal) in enumerate(places, start=1)
    )
    pool = points[(points[:, 2] > 0.119) & (points[:, 0] < 1.0)]
    return PictureLayout(
        points, faces, pool, gauges, (LoadArrow("tip", np.array([2.0, 0.04, 0.06]), z),), points[points[:, 0] == 0]
    )


def mixed_layout():
    """Every kind of sensor on the same box: a rosette, mirrored gauges, some bonded already, a triaxial accelerometer."""
    beam = layout()
    one, two, below, far = beam.gauges
    turn = np.radians([0, 45, 90])
    fan = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(3)])
    side, up = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    gauges = (
        replace(one, peak=9.1e-5, range=3e-3, mirror="G3"),
        replace(two, kind="rosette", directions=fan, peak=2.4e-4, range=2e-4),
        replace(below, peak=9.1e-5, range=3e-3, mirror="G1", bonded=True),
        replace(far, kind="accelerometer", position=np.array([1.9, 0.04, 0.12]), normal=up, directions=np.eye(3),
                direction=np.eye(3)[0], peak=41.2, unit="m/s^2", label="G4", facet=0, nodes=(2,)),
        Gauge("G5", 1310, 2, np.array([1.5, 0.0, 0.06]), side, side, 0.0, {"E": np.inf}, (5, 6), bonded=True,
              kind="accelerometer", peak=np.nan, range=50.0, unit="m/s^2"),
        Gauge("G6", 1400, 3, np.array([1.2, 0.04, 0.12]), up, up, 0.0, {}, (8, 9), kind="displacement sensor",
              peak=4.3e-4, range=2e-3, unit="m"),
    )  # fmt: skip
    return replace(beam, gauges=gauges)


@pytest.fixture
def mixed():
    """A function: changed fields → report on a layout with every kind of sensor, and a signal of every channel."""

    def make(**changes):
        time = np.arange(1001) * 1e-3
        wave = np.sin(2 * np.pi * 20 * time)
        labels = ["G1", *(f"G2 {angle}°" for angle in (0, 45, 90)), "G3", *(f"G4 {axis}" for axis in "xyz"), "G5", "G6"]
        size = {"G4": (41.2, "m/s^2"), "G5": (12.0, "m/s^2"), "G6": (4.3e-4, "m")}
        signals = []
        for label in labels:
            peak, unit = size.get(label[:2], (9e-5, "strain"))
            small = np.full(1001, 0.01 * peak)
            gauge = int(label[1]) - 1
            signals.append(Reading(label, unit, time, peak * wave + small, peak * wave, small, gauge, peak * wave))
        return report(**{"layout": mixed_layout(), "gauge_signals": tuple(signals)} | changes)

    return make


def posterior(value, density, prior):
    return Posterior(value=value, density=density, prior=prior, left=0.1, peak=np.empty(0), share=np.empty(0))


def oscillators():
    """Strain of four gauges per N of two loads, each with one mode: H = c/(1 − r² + 2iζr), r = f/f₁."""
    frequency = np.unique(np.append(np.geomspace(4, 120, 60), [0.0, 40.12, 58.9]))
    r = frequency[:, None, None] / np.array([40.12, 58.9])
    H = 1e-8 * np.arange(1, 5)[:, None] * np.array([1.0, 0.3]) / (1 - r**2 + 0.02j * r)
    return FrequencyResponse(
        load=("tip", "thrust"), unit=("N", "N"), channel=("G1", "G2", "G3", "G4"), gauge=np.arange(4), frequency=frequency,
        magnitude=np.abs(H), phase=np.angle(H), natural=np.array([40.12, 58.9]), excited=np.eye(2, dtype=bool),
    )  # fmt: skip


@pytest.fixture
def full():
    return report


def report(**changes):
    draw = np.random.default_rng(1)
    time = np.arange(1001) * 1e-3
    count = np.arange(30, 3, -1)
    trace = 1 + (30 / count - 1) * 0.25
    mean = 2.1e11 - 2.1e10 * np.exp(-time / 0.02)
    load = 1e4 * np.sin(2 * np.pi * 20 * time)
    strain = 9e-5 * np.sin(2 * np.pi * 20 * time)
    spread, narrow, wide = np.linspace(-0.004, 0.004, 401), norm(-4e-4, 8e-4), norm(-0.1, 0.1)
    load_claims = tuple(Claim(kind, 1, ratio, ONE, "consistent") for kind, ratio in (("test", 0.177 / 0.159), ("smoothed", 1.05)))
    full = PlacementReport(
        name="cantilever-input-youngs-modulus",
        title="Cantilever: load and stiffness",
        settings=Report(),
        unknowns=(
            Unknown("tip", "N", "input", 1e4, 7071.0, 7050.0, 0.177, 0.159, 0.042, 0.163, False, 0.04, load_claims),
            Unknown("E", "Pa", "parameter", 1.89e11, 2.1e11, 2.0989e11, 0.000523, 0.000814, None, 0.000787,
                    claims=(Claim("repeats", 20, 6.64, TWENTY, "overconfident"), HELD),
                    repeats=Repeats(np.linspace(-0.003, 0.01, 20), np.full(20, 0.0008), False)),
        ),
        layout=layout(),
        trend=Trend(count, trace, {"tip": 0.7 * trace, "E": 0.3 * trace}, 2.62, METRICS[0], 2.6187, 2.62 / 2.6187 - 1),
        histories=(
            History("tip", "N", time, load, 0.95 * load, np.full(1001, 1.6e3), load + 100.0, np.full(1001, 400.0)),
            History("E", "Pa", time, np.full(1001, 2.1e11), mean, np.full(1001, 1.7e8)),
        ),
        posteriors={"E": posterior(2.1e11 * np.exp(spread), narrow.pdf(spread), wide.pdf(spread))},
        gauge_signals=tuple(
            Reading(
                f"G{i}", "strain", time, strain + draw.normal(size=1001) * 1e-6, strain, np.full(1001, 1.5e-7), i - 1, strain
            )
            for i in range(1, 5)
        ),
        random_sets=(
            RandomSetErrors("E", "all candidates", np.linspace(0.0011, 0.02, 10), np.tile(mean, (10, 1)), 0.000523),
            RandomSetErrors("E", "screened", np.append(np.linspace(0.0007, 0.002, 9), np.nan), np.tile(mean, (10, 1)), 0.000523),
            RandomSetErrors("tip", "screened", np.linspace(0.17, 0.5, 10), None, 0.177),
        ),
        noise=Noise(
            np.array([0.001, 0.01, 0.05]),
            {"tip": np.array([0.05, 0.177, 0.4]), "E": np.array([6.1e-5, 0.000523, 0.0031])},
            {"tip": np.array([0.06, 0.159, 0.41]), "E": np.array([9.1e-5, 0.000814, 0.0042])},
        ),
        frequencies=(40.12, 58.9, 247.3),
        frequency_response=oscillators(),
        metrics=METRICS,
        criteria=(
            Criteria("elimination, exchange", (2.62, 0.047, 1.7), {"tip": 1.15e3, "E": 1.65e8}),
            Criteria("random layout (median of 10 layouts)", (np.inf,) * 3, {"tip": 2.1e3, "E": np.inf}),
            Criteria("effective independence", (3.5, 0.074, 2.9), {"tip": 1.3e3, "E": 1.9e8}),
            Criteria("log-determinant", (2.71, 0.043, 1.9), {"tip": 1.2e3, "E": 1.6e8}),
        ),
        cases=tuple(
            ObservabilityCase(unknowns, excitation, hard * factor, 1e16 * hard, lost)
            for excitation, factor in (("training simulation", 1.0), ("35 Hz", 2.0))
            for unknowns, hard, lost in (
                (("tip",), 8.0, ""),
                (("E", "rho"), 91.0, ""),
                (("tip", "E", "rho"), 9e11, "tip, E and rho scaled by one factor"),
            )
        ),
        budget=BUDGET,
        advice=("2 gauges more would lower σ by 7 %.", "G1 and G3 are redundant: either can replace the other."),
        observability={"condition (scaled)": 91.0, "condition (raw)": 3.1e23},
        truth_description="60 modes with static terms, damping 1.5 times the filter's",
        consistency=(
            Check("NEES, mean of the run (band of one instant)", 1.04, (0.9, 1.1), "consistent"),
            Check("NIS of the gauges, mean of the run", 1.31, (0.96, 1.04), "overconfident"),
        ),
        warnings=("G1 and G2 are 200 mm apart.",),
        not_tested=("Temperature.",),
        facts={"mesh": "3 214 nodes"},
        provenance={"seed": "1"},
    )  # fmt: skip
    return replace(full, **changes)


@pytest.fixture
def bare():
    """The same placement with everything left out that a run may lack."""
    full = report()
    unknowns = tuple(Unknown(unknown.name, unknown.unit, unknown.kind, unknown.reference) for unknown in full.unknowns)
    trend = replace(full.trend, lower_bound=None, gap=None, blocks={})
    return PlacementReport("bare", "Bare", Report(), unknowns, full.layout, trend)


@pytest.fixture
def suite():
    """A function: changed fields → suite of four runs: consistent, not identified, overconfident, only observed."""
    return suite_report


def suite_report(**changes):
    """The runs of the small placement report: E alone; tip and E, not identified; the same, overconfident; observed."""
    full = report()
    load, modulus = full.unknowns
    agree = Claim("repeats", 20, 0.875, TWENTY, "consistent")
    agreed = Repeats(np.full(20, 0.0007), np.full(20, 0.0008), True)
    done = PlacementRun(
        "beam-E", "E, 20 Hz", page="../beam-E/report.html", reached="report",
        unknowns=(replace(modulus, claims=(HELD, agree), repeats=agreed),),
        pool=30, trend=full.trend, layout=full.layout, histories=full.histories[1:],
        cases=full.cases, frequencies=full.frequencies, truth_description=full.truth_description,
    )  # fmt: skip
    joint = replace(
        done, name="beam-tip-E", label="tip + E, 20 Hz", note="A softer beam under a smaller load strains alike.",
        page=None, unknowns=full.unknowns, histories=full.histories, warnings=full.warnings,
        trend=replace(full.trend, value=2 * full.trend.value[0] * full.trend.value**2, final=13.0, gap=0.03),
    )  # fmt: skip
    wrong = replace(
        joint, name="beam-wrong", label="tip + E, slow", note="",
        unknowns=(load, replace(modulus, error=0.02, claims=(replace(HELD, ratio=24.6, result="overconfident"),), repeats=None)),
        cases=tuple(replace(case, condition=1.5 * case.condition) for case in full.cases),
    )  # fmt: skip
    guess = Unknown("E", "Pa", "parameter", 1.89e11)
    seen = PlacementRun(
        "beam-all", "all three", "no gauge tells all three.", reached="observe", unknowns=(guess,), cases=full.cases
    )
    runs = (done, joint, wrong, seen)
    return replace(Suite("beam", "The beam of chapter 6.1", runs, provenance={"seed": "1"}), **changes)
