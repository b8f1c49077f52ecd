"""The underside of a bolted part is named where gauges may sit on it, and is not where the config leaves it out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from strainsight import api
from strainsight.cases.structure.contact import contact_warnings, held_below
from strainsight.config.template import template
from strainsight.gauges.candidates import candidates
from strainsight.gauges.faces import faces_of
from strainsight.mesh.facets import exterior_facets
from strainsight.stages.suggestion import suggestion

ROOT = Path(__file__).parents[2]
LUG, DECK = ROOT / "configs" / "lug" / "lug-input.yaml", ROOT / "meshes" / "lug.bdf.gz"
SEAT = "mesh.faces={seat: {near: [-0.0036, -0.003, 0]}}"


def warned(*changes):
    case = api.load(LUG, ["gauges.exclude=[]", "gauges.surface=all", *changes])
    mesh = api.mesh(case)
    facets = exterior_facets(mesh)
    return list(contact_warnings(case.config, mesh, facets, faces_of(mesh.position, facets)))


def test_the_import_says_what_leaves_the_underside_out_and_then_no_more():
    (said,) = warned()
    assert said.startswith("the flat face of 0.023 m² about (0, 0, 0) m is held by 4 bores")
    lines = dict(part.split(": ", 1) for part in said.split("leave it out with ")[1].split(" and "))
    assert not warned(*(f"{key}={value}" for key, value in lines.items()))
    (named,) = warned(SEAT)
    assert named.endswith("leave it out with gauges.exclude: [seat]")
    assert not warned("gauges.surface=SET1-11")


@pytest.mark.parametrize("seat", [True, False])
def test_each_gauge_on_that_face_says_what_holds_it(seat):
    mesh = api.mesh(api.load(LUG))
    pool = candidates(mesh, exterior_facets(mesh), None, (0.0,))
    below = pool.normal[:, 2] < -0.99
    below &= pool.position[:, 2] < 1e-9
    said = held_below(mesh, pool)
    want = "the face about (0, 0, 0) m is held by 4 bores" if seat else ""
    assert below.any()
    assert {text for text, own in zip(said, below == seat, strict=True) if own} == {want}


def test_init_lists_it_and_writes_the_lines_as_comments_that_hold():
    found = suggestion(DECK)
    (own,) = [place for place in found.places if place.lies_on]
    assert own.lies_on == "held by 4 bores"
    text = template("lug.bdf.gz", found)
    assert "held by 4 bores: does something lie on it?" in text
    (line,) = [line for line in text.splitlines() if "#   - seat " in line]
    name, faces = line.split("- ")[1].split()[0], line.split("mesh.faces: ")[1]
    (said,) = warned()
    assert said.endswith(f"mesh.faces: {faces} and gauges.exclude: [{name}]")
    point = yaml.safe_load(faces)[name]["near"]
    assert np.abs(point[2]) < 1e-9
