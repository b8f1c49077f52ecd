"""A bearing alone from its config: which cases and curves are of which bearing, what is printed, what is refused."""

from __future__ import annotations

import pytest

from ..models import Ended, ended

RADII = ", ".join(f"radius_{ring}_{side}: 0.0318" for ring in ("inner", "outer") for side in ("left", "right"))
TWO = f"""
kind: bearing
name: alone
bearings:
  first: {{balls: 40, ball_diameter: 0.06, pitch_diameter: 1.0, contact_angle: 45, {RADII}}}
  second: {{balls: 20, ball_diameter: 0.06, pitch_diameter: 1.0, contact_angle: 45, {RADII}}}
cases:
  both: {{force: [1.37345e+5, 0, 0]}}
  own: {{force: [1.0e+4, 0, 0], bearing: second}}
curves:
  - {{along: x, reach: 1.0e-4, points: 5}}
  - {{along: tilt_z, reach: 1.0e-4, points: 5, bearing: [first]}}
"""


def run(text: str, *changes: str) -> Ended:
    return ended("run", text, *changes)


@pytest.mark.slow
def test_cases_and_curves_are_of_the_bearings_they_name():
    end = run(TWO)
    found = end.artefact("bearing")
    pairs = {name.removeprefix("pressure.") for name in found.summary if name.startswith("pressure.")}
    assert pairs == {"first.both", "second.both", "second.own"}
    page = (end.folder / "bearing.html").read_text(encoding="utf-8")
    assert "second under load case own" in page
    assert "first under load case own" not in page
    assert "first: load versus displacement tilt about z" in page
    assert "second: load versus displacement x" in page
    assert "second: load versus displacement tilt about z" not in page


@pytest.mark.parametrize("force", ["1.0e+9", "1.0e+15"])
def test_a_load_that_the_bearing_cannot_carry_is_the_users_to_correct(force):
    done = run(TWO, f"cases.own.force=[{force}, 0, 0]")
    assert done.code == 2, done.output
    assert "cases.own" in done.stderr
    assert "'second'" in done.stderr


@pytest.mark.slow
def test_a_pressure_beyond_what_a_raceway_bears_is_warned_of():
    done = run(TWO, "bearings.second.pressure_limit=1.0e+9", "cases.own.force=[1.0e+5, 0, 0]", "curves=[]")
    assert done.code == 0
    assert "the contact pressure of second under load case own is" in done.output
    assert "above the limit of 1000 MPa" in done.output
