"""A mesh cut at the middle of its edges is the same body, conforming, and holds what the coarse one holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.fem.assembly import assemble
from strainsight.fem.mass import mass_properties
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.kinds.kind import with_midsides
from strainsight.mesh.model import CellBlock
from strainsight.mesh.subdivision import refined

from ..bodies import RHO, body
from ..solids import SOLIDS

PARTS = {"tet4": 8, "tet10": 8, "hex8": 8, "hex20": 8, "wedge6": 8, "wedge15": 8, "pyra5": 10}


def block(kind, chart=lambda u, v, w: (u, v, w)):
    return body(kind, (2, 1, 1), chart)


@pytest.mark.parametrize("kind", SOLIDS)
def test_the_parts_fill_the_body_and_share_their_nodes(kind):
    """As many as the kind has, of the same volume and centre; no facet inside is left open: the surface has its area."""
    mesh = block(kind)
    fine = refined(mesh).mesh
    assert sum(len(own.ids) for own in fine.blocks) == PARTS[kind] * len(mesh.blocks[0].ids)
    np.testing.assert_allclose(mass_properties(fine)[1], mass_properties(mesh)[1], atol=1e-12)
    assert mass_properties(fine)[0] == pytest.approx(2 * RHO)
    coarse, facets = exterior_facets(mesh), exterior_facets(fine)
    assert len(facets.kind) == 4 * len(coarse.kind)


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_field_of_the_coarse_mesh_has_its_energy_on_the_fine_one(kind):
    """Straight elements: the spaces are nested, so P'KP = K. Hexahedra of 8 nodes have incompatible modes beside, and pyramids
    functions that are no polynomials: of them only linear fields."""
    mesh = block(kind)
    own = refined(mesh)
    z = np.random.default_rng(2).standard_normal(3 * len(mesh.position))
    fine = (own.interpolation @ z.reshape(-1, 3)).ravel()
    before, after = z @ (assemble(mesh)[0].constant @ z), fine @ (assemble(own.mesh)[0].constant @ fine)
    if kind in ("hex8", "pyra5"):
        z = (mesh.position @ np.random.default_rng(3).standard_normal((3, 3))).ravel()
        fine = (own.interpolation @ z.reshape(-1, 3)).ravel()
        before, after = z @ (assemble(mesh)[0].constant @ z), fine @ (assemble(own.mesh)[0].constant @ fine)
    assert after == pytest.approx(before, rel=1e-10)


@pytest.mark.parametrize("kind", ["tet10", "hex20", "wedge15"])
def test_a_curved_surface_keeps_its_shape(kind):
    """Nodes of the fine mesh lie on the quadratic surface of the coarse one: on the cylinder to a tenth of the sag of chords."""

    def bend(u, v, w):
        angle, radius = 0.5 * u, 1 + v
        return radius * np.sin(angle), radius * np.cos(angle), w

    mesh = block(kind, bend)
    fine = refined(mesh).mesh
    facets = exterior_facets(fine)
    nodes = np.unique(facets.nodes[facets.nodes >= 0])
    radius = np.hypot(fine.position[nodes, 0], fine.position[nodes, 1])
    outer = np.abs(radius - 2) < 0.02
    assert outer.sum() > 20
    assert np.abs(radius[outer] - 2).max() < 0.1 * 2 * (1 - np.cos(0.125))


@pytest.mark.parametrize("kind", SOLIDS)
def test_nodes_of_parts_of_facets_are_found(kind):
    """At every node of every part of every exterior facet: the node of the fine mesh that lies there."""
    mesh = block(kind)
    own = refined(mesh)
    facets = exterior_facets(mesh)
    for code in np.unique(facets.kind):
        face = FACETS[code]
        nodes = facets.nodes[facets.kind == code][:, : len(face.nodes)]
        for name, corners in face.split:
            xi = with_midsides(corners, next(kind for kind in FACETS if kind.name == name).edges)
            at = own.mesh.position[own.nodes_at(face, nodes, xi)]
            np.testing.assert_allclose(at, np.einsum("qk,ekc->eqc", face.shape(xi), mesh.position[nodes]), atol=1e-12)


def test_bodies_that_only_touch_stay_apart():
    """Two copies in one place, with nodes of their own, are two bodies after it."""
    mesh = block("hex8")
    count, cells = len(mesh.position), mesh.blocks[0]
    twin = CellBlock("hex8", cells.ids + 10, cells.nodes + count, cells.region)
    both = replace(
        mesh,
        node_ids=np.arange(1, 2 * count + 1),
        position=np.vstack([mesh.position, mesh.position]),
        blocks=(replace(cells, ids=np.r_[cells.ids, twin.ids], nodes=np.vstack([cells.nodes, twin.nodes]),
                        region=np.r_[cells.region, twin.region]),),
    )  # fmt: skip
    assert len(refined(both).mesh.position) == 2 * len(refined(mesh).mesh.position)
