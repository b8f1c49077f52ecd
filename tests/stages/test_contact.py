"""The underside of a bolted part is named where gauges may sit on it, and is not where the config leaves it out."""

from __future__ import annotations

import json
from pathlib import Path

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
    facets = exterior_facets(mesh)
    pool = candidates(mesh, facets, None, (0.0,))
    below = pool.normal[:, 2] < -0.99
    below &= pool.position[:, 2] < 1e-9
    said = held_below(mesh, facets, pool)
    want = "the face about (0, 0, 0) m is held by 4 bores" if seat else ""
    assert below.any()
    assert {text for text, own in zip(said, below == seat, strict=True) if own} == {want}


def test_init_leaves_it_out_as_the_warning_says_and_the_example_does():
    found = suggestion(DECK)
    (own,) = [place for place in found.places if place.lies_on]
    assert own.lies_on == "held by 4 bores"
    text = template("lug.bdf.gz", found)
    assert "held by 4 bores: does something lie on it?" in text
    written = yaml.safe_load(text)
    (said,) = warned()
    assert said.endswith(f"mesh.faces: {{seat: {{near: {own.name}}}}} and gauges.exclude: [seat]")
    assert (written["mesh"]["faces"], written["gauges"]["exclude"]) == ({"seat": {"near": json.loads(own.name)}}, ["seat"])
    shipped = yaml.safe_load((LUG.parent / "lug-youngs-modulus.yaml").read_text())
    assert all(shipped[of][key] == written[of][key] for of, key in (("mesh", "faces"), ("gauges", "exclude")))
