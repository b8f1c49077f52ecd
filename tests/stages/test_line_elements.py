"""Rods and pinned beams carry no candidates; what is said of them, and that the remedies work."""

from __future__ import annotations

import pytest
import yaml
from typer.testing import CliRunner

from strainsight_cli.main import app

WHY = "rods and beams with released ends (pin flags) have no surface"
CONFIG = {
    "kind": "placement",
    "name": "own",
    "loads": {"tip": {"direction": [0, 0, -1], "known": False, "signal": {"type": "sine", "frequency": 1.0, "amplitude": 100.0}}},
    "damping": {"type": "modal", "ratio": 0.01},
    "rom": {"modes": 3},
    "train": {"duration": 1.0, "time_step": 0.05, "model": "static"},
    "gauges": {"direction": {"type": "principal", "angles": [0]}, "noise_std": {"value": 5.0e-7}},
    "place": {"estimate": ["tip"], "keep": 2},
}
FEET = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0))
TOP = (0.5, 0.5, 1.0)


def truss(member):
    """Three members from clamped feet to a loaded node 10."""
    lines = ["CEND", "SPC = 1", "BEGIN BULK", "MAT1,1,2.1+11,,0.3,7850.", "PROD,1,1,1.-4", "PBARL,2,1,,BAR", ",0.02,0.01"]
    lines += ["SPC1,1,123456,1,2,3", "GRID,10,,{:g},{:g},{:g}".format(*TOP)]
    for i, foot in enumerate(FEET, start=1):
        middle = [(a + b) / 2 for a, b in zip(foot, TOP, strict=True)]
        lines += ["GRID,{},,{:.3f},{:.3f},{:.3f}".format(n, *x) for n, x in ((i, foot), (10 + i, middle))]
        lines += member(i)
    return "\n".join([*lines, "ENDDATA", ""])


RODS = truss(lambda i: [f"CROD,{20 + i},1,{i},10"])
BARS = truss(lambda i: [f"CBAR,{20 + i},2,{i},{10 + i},0.,0.,1.", f"CBAR,{30 + i},2,{10 + i},10,0.,0.,1."])
PLATE = """\
*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 2, 0, 0
4, 0, 1, 0
5, 1, 1, 0
6, 2, 1, 0
10, 2, 0, 1
11, 2, 1, 1
*ELEMENT, TYPE=S4, ELSET=PLATE
1, 1, 2, 5, 4
2, 2, 3, 6, 5
*ELEMENT, TYPE=T3D2, ELSET=STAYS
51, 3, 10
52, 6, 11
*MATERIAL, NAME=STEEL
*ELASTIC
2.1e11, 0.3
*DENSITY
7850
*SHELL SECTION, ELSET=PLATE, MATERIAL=STEEL
0.01
*SOLID SECTION, ELSET=STAYS, MATERIAL=STEEL
1e-4
*BOUNDARY
1, 1, 6
4, 1, 6
10, 1, 3
11, 1, 3
"""


@pytest.fixture
def strainsight(tmp_path, monkeypatch):
    """strainsight(deck, *words, node, sections): run a command on own.yaml with this deck and load."""
    monkeypatch.chdir(tmp_path)

    def call(deck, *words, node, sections=tuple(CONFIG), **gauges):
        name = "own.inp" if deck.startswith("*") else "own.bdf"
        (tmp_path / name).write_text(deck)
        config = {key: CONFIG[key] for key in sections} | {"mesh": {"file": name}}
        if "gauges" in config:
            config["gauges"] = config["gauges"] | gauges
        if "loads" in config:
            config["loads"] = {"tip": CONFIG["loads"]["tip"] | {"node": node}}
        (tmp_path / "own.yaml").write_text(yaml.safe_dump(config, sort_keys=False))
        return CliRunner().invoke(app, [*words])

    return call


def test_deck_of_rods_is_refused_by_train_and_announced_by_init(strainsight):
    """With members, property and remedy; the mesh alone has modes."""
    done = strainsight(RODS, "train", "own.yaml", node=10)
    words = f"the mesh has no surface for gauges: it consists of 3 line elements (PROD 1: 21, 22, 23), and {WHY}"
    assert done.exit_code == 2
    where, _, remedy = done.stderr.partition("\n    ")
    assert words in where
    assert "gauges" in where.partition(words)[0]
    assert "beams without pin flags, with shells or with solids" in remedy
    init = CliRunner().invoke(app, ["init", "own.bdf", "-o", "written.yaml"])
    assert (init.exit_code, init.output.count(words)) == (0, 1)
    done = strainsight(RODS, "modes", "own.yaml", node=10, sections=("kind", "name", "rom"))
    assert done.exit_code == 0, done.output + done.stderr


def test_members_of_beams_instead_of_rods_have_candidates(strainsight):
    """The remedy: of two bars a member, the upper one has four sides without a clamped node."""
    done = strainsight(BARS, "train", "own.yaml", node=10)
    assert done.exit_code == 0, done.output + done.stderr
    assert "12 candidates" in done.output
    assert "line element" not in done.output


def test_rods_with_shells_are_noted_once(strainsight):
    """Two faces of the shell away from the clamp; a pinned beam would be counted with the rods."""
    done = strainsight(PLATE, "train", "own.yaml", node=3)
    assert done.exit_code == 0, done.output + done.stderr
    assert "2 candidates" in done.output
    assert done.output.count(f"no candidates on 2 line elements (STAYS: 51, 52), because {WHY}") == 1
    assert WHY not in done.stderr


def test_a_set_of_rods_as_surface_names_them(strainsight):
    done = strainsight(PLATE, "train", "own.yaml", node=3, surface="STAYS")
    assert done.exit_code == 2
    assert f"0 facets on the surface 'STAYS'. No facets on 2 line elements (STAYS: 51, 52), because {WHY}" in done.stderr
    assert "beams without pin flags" in done.stderr
    done = strainsight(PLATE, "train", "own.yaml", node=3, exclude=["PLATE"], surface="PLATE")
    assert (done.exit_code, "line element" in done.stderr) == (2, False)
