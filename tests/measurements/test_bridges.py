"""The inverse of an exact Wheatstone bridge, solved by Kirchhoff's laws."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements.bridges import ARRANGEMENTS, Bridge, strain_of

NU = 0.29
GAUGES = {
    # Where the resistors R1 to R4 sit: "+" along in tension, "-" along in compression, "t" across a "+", "c" across a "-", "q"
    # and "p" where a quarter of the sum is, in tension and in compression.
    "quarter": "+   ",
    "half": "+-  ",
    "half-opposite": "+ + ",
    "half-poisson": "+t  ",
    "full": "+-+-",
    "full-bending-poisson": "+-ct",
    "full-poisson": "+t+t",
    "sum": "qpqp",
}


def output(places: str, gauge_factor: float, strain: float) -> float:
    """Output over excitation: the two node voltages of four resistors under 1 V.

    R1 from the supply to node A, R2 from A to ground, R4 from the supply to node B, R3 from B to ground.
    """
    local = {"+": strain, "-": -strain, "t": -NU * strain, "c": NU * strain, " ": 0.0}
    local |= {"q": strain / 4, "p": -strain / 4}
    return wheatstone(gauge_factor * np.array([local[place] for place in places]))


def wheatstone(x: np.ndarray) -> float:
    """Of relative changes (4,) of the four resistances."""
    R1, R2, R3, R4 = 350.0 * (1 + x)
    conductance = np.diag([1 / R1 + 1 / R2, 1 / R3 + 1 / R4])
    node = np.linalg.solve(conductance, [1 / R1, 1 / R4])
    return node[1] - node[0]


@pytest.mark.parametrize("arrangement", ARRANGEMENTS)
@pytest.mark.parametrize("strain", [1e-6, 1e-3, 0.05, -1e-6, -1e-3, -0.05])
def test_the_formula_inverts_an_exact_bridge(arrangement, strain):
    bridge = Bridge(arrangement, 2.07, NU if "poisson" in arrangement else None)
    r = output(GAUGES[arrangement], 2.07, strain)
    # A difference of two voltages near 0.5 V carries 1e-16 V.
    assert strain_of(bridge, np.array([r]))[0] == pytest.approx(strain, rel=1e-12, abs=1e-15)
    assert r * strain > 0


def test_a_small_output_is_linear_and_a_quarter_bridge_reads_low_in_tension():
    r = np.array([1e-9])
    for arrangement, factor in {
        "quarter": 1,
        "half": 2,
        "half-poisson": 1 + NU,
        "full": 4,
        "full-poisson": 2 * (1 + NU),
    }.items():
        bridge = Bridge(arrangement, 2.0, NU if "poisson" in arrangement else None)
        np.testing.assert_allclose(strain_of(bridge, r), 4 * r / (2.0 * factor), rtol=1e-8)
    # TN-507: at 1000 microstrain, gauge factor 2, a linear reading of a quarter bridge is 0.1 % low.
    read = output("+   ", 2.0, 1e-3) * 4 / 2.0
    assert 1 - read / 1e-3 == pytest.approx(1e-3, rel=2e-3)


@pytest.mark.parametrize(
    ("arms", "low"),
    [
        ((900e-6, -900e-6, 400e-6, -400e-6), 0.0),  # neighbours that add up to zero
        ((1000e-6, 0.0, 1000e-6, 0.0), 1e-3),  # axial, two completed by resistors: as low as a quarter bridge
        ((1500e-6, -500e-6, 700e-6, -300e-6), (2000 * 1000 + 1000 * 400) / 3000 * 1e-6),
    ],
)
def test_a_sum_is_linear_and_off_by_what_neighbouring_arms_have_in_common(arms, low):
    """GF 2: every leg is read (ε₁ + ε₂) of its share too low, to first order; the second order is 1e-6 of it here."""
    arms = np.array(arms)
    total = arms @ [1, -1, 1, -1]
    r = wheatstone(2.0 * arms)
    read = strain_of(Bridge("sum", 2.0), np.array([r]))[0]
    assert read == pytest.approx(4 * r / 2.0, rel=1e-14)
    assert 1 - read / total == pytest.approx(low, rel=2e-3, abs=1e-12)


def test_missing_samples_stay_missing_and_the_impossible_becomes_so():
    r = np.array([np.nan, 0.0, 0.49, 0.5, 0.7, -0.49, -0.5, 9.0])
    np.testing.assert_array_equal(np.isnan(strain_of(Bridge("quarter", 2.0), r)), [1, 0, 0, 1, 1, 0, 1, 1])
    np.testing.assert_array_equal(
        np.isnan(strain_of(Bridge("full", 2.0), np.array([0.99, 1.01, -0.99, -1.01]))), [0, 1, 0, 1]
    )


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (("quartr", 2.0), "unknown bridge"),
        (("quarter", 0.0), "gauge factor"),
        (("quarter", float("nan")), "gauge factor"),
        (("half-poisson", 2.0), "no Poisson's ratio"),
        (("half", 2.0, 0.3), "no gauge across"),
        (("full-poisson", 2.0, 0.5), "outside"),
    ],
)
def test_bridges_that_cannot_be(wrong, said):
    with pytest.raises(UserError, match=said):
        Bridge(*wrong)
