"""A bearing alone from its config: which cases and curves are of which bearing, what is printed, what is refused."""

from __future__ import annotations

import re

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
SPRING = """
kind: bench
name: hanging
bodies:
  bob: {type: rigid, mass: 2.0, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}, pose: {origin: [0, 0, -1.0]}}
frames:
  hook: {body: ground, pose: {origin: [0, 0, PLACE]}}
  centre: {body: bob}
joints:
  guide: {type: prismatic, frames: [hook, centre], axis: z}
forces:
  weight: {type: gravity}
  spring: {type: spring, frames: [hook, centre], stiffness: 1000.0, length: 0.5}
simulate: {duration: 0.01, time_step: 1.0e-3, start: START}
"""


def run(text: str, *changes: str) -> Ended:
    return ended("run", text, *changes)


def test_cases_and_curves_are_of_the_bearings_they_name():
    end = run(TWO)
    found = end.artefact("bearing")
    pairs = {name.removeprefix("pressure.") for name in found.summary if name.startswith("pressure.")}
    assert pairs == {"first.both", "second.both", "second.own"}
    page = (end.folder / "bearing.html").read_text(encoding="utf-8")
    assert "second under own" in page
    assert "first under own" not in page
    assert "first: load over tilt about z" in page
    assert "second: load over x" in page
    assert "second: load over tilt about z" not in page


def test_page_and_terminal_show_the_same_table():
    """Same columns in the same order, same numbers to the digits shown."""
    end = run(TWO)
    page = (end.folder / "bearing.html").read_text(encoding="utf-8")
    table = re.search(r"<h2>first under both</h2>(.*?)</table>", page, re.DOTALL).group(1)
    head = [re.sub("<.*?>", "", cell) for cell in re.findall(r"<th.*?>(.*?)</th>", table)]
    values = [float(value) for value in re.findall(r'<data value="(.*?)"', table)][:7]
    lines = end.output.split("first under both")[1].splitlines()
    printed = [cell.strip() for cell in re.split(r"\s{2,}", lines[1].strip())]
    cells = [float(cell.split()[0]) for cell in re.split(r"\s{2,}", lines[2].strip())[1:]]
    assert head[0] == "along"
    assert printed == head[1 : 1 + len(printed)]
    assert printed[:2] == ["load", "displacement"]
    assert cells == pytest.approx(values, rel=1e-3)
    assert cells[0] == 137345


@pytest.mark.parametrize("force", ["1.0e+9", "1.0e+15"])
def test_a_load_that_the_bearing_cannot_carry_is_the_users_to_correct(force):
    done = run(TWO, f"cases.own.force=[{force}, 0, 0]")
    assert done.code == 2, done.output
    assert "cases.own" in done.stderr
    assert "'second'" in done.stderr


@pytest.mark.parametrize("start", ["equilibrium", "as_given"])
def test_a_spring_without_length_has_no_direction(start):
    done = run(SPRING.replace("PLACE", "-1.0").replace("START", start))
    assert done.code == 2, done.output
    assert "forces.spring: at the start" in done.stderr
    assert "own.yaml:13" in done.stderr
    assert "'hook' and 'centre' are 0 m apart" in done.stderr


def test_a_spring_with_length_holds_its_weight():
    done = run(SPRING.replace("PLACE", "0").replace("START", "equilibrium"))
    assert done.code == 0, done.output
