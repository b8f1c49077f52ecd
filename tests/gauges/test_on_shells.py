"""Gauges on shells: bridges through their thickness, and which of two faces a place is on."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.gauges.bonded import BondedEntry, bonded
from strainsight.gauges.bridges import bridges
from strainsight.gauges.candidates import candidates
from strainsight.gauges.rows import channel_rows
from strainsight.gauges.walk import skin_of
from strainsight.mesh.facets import LOWER, UPPER, exterior_facets

from ..fem.test_thin import B, L, T, strip

STRETCH, CURVATURE = 2e-4, 0.03


@pytest.mark.parametrize(("pattern", "reads"), [("half-bending", T * CURVATURE), ("half-axial", 2 * STRETCH)])
def test_a_half_bridge_through_the_thickness_reads_bending_or_tension_alone(pattern, reads):
    """u = ε x − κ x z, w = κ x²/2: ε on the faces is ε ∓ κ T/2."""
    mesh = strip()
    facets = exterior_facets(mesh)
    skin = skin_of(mesh.position, facets)
    pool = candidates(mesh, facets, axis=(-1.0, 0.0, 0.0), on_constraints=True)
    found = bridges(skin, pool, pattern, np.arange(len(facets.kind))).candidates
    x, _, z = mesh.position.T
    u = np.column_stack([STRETCH * x - CURVATURE * x * z, np.zeros(len(x)), CURVATURE * x**2 / 2])
    assert found.gauges == len(mesh.shells[0].ids)
    np.testing.assert_allclose(found.arms.grid.position[:, 2], -found.position[:, 2])
    np.testing.assert_allclose(abs(found.position[:, 2]), T / 2)
    read = channel_rows(mesh.position, found, u.reshape(-1, 1))[:, 0]
    np.testing.assert_allclose(read, np.sign(-found.position[:, 2]) * reads if pattern == "half-bending" else reads)


def test_a_bonded_gauge_is_on_the_face_that_it_is_nearer_to_and_in_the_middle_it_is_refused():
    mesh = strip()
    facets = exterior_facets(mesh)

    def at(z):
        entry = BondedEntry(position=(0.31 * L, 0.3 * B, z), direction=(1, 0, 0), name="A")
        return bonded(mesh, facets, [entry], tolerance=T)[0]

    for z, face in ((0.6 * T, UPPER), (0.4 * T, UPPER), (0.01 * T, UPPER), (-0.01 * T, LOWER), (-0.9 * T, LOWER)):
        assert at(z).facet == face
    with pytest.raises(UserError, match="bonded gauge A is as near to the upper face of shell 7 as to the lower one"):
        at(0.0)
