"""Relations, their gradients and their curvature."""

import numpy as np

from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.products import compile_products, curvature, relation_rows
from strainsight.multibody.relations import bearing_displacements, coincidence, distance_squared, dot, offset
from strainsight.multibody.system import assemble


def all_relations(everything):
    system, q, v = everything.system, everything.q, everything.v
    return system.products, q, v


def test_gradients_are_the_differences_of_the_values(everything):
    p, q, v = all_relations(everything)
    q = q + 0.1 * everything.rng.normal(size=len(q))
    _, G, G_rate, _, _ = relation_rows(p, q, v)
    # of degree four in q: a five-point difference is exact
    e = 0.05
    for k, unit in enumerate(np.eye(len(q))):

        def at(s, u=unit):
            return relation_rows(p, q + s * u, v)

        near, far = [at(e), at(-e)], [at(2 * e), at(-2 * e)]
        slope = (8 * (near[0][0] - near[1][0]) - (far[0][0] - far[1][0])) / (12 * e)
        np.testing.assert_allclose(G[:, k], slope, rtol=0, atol=1e-11 * max(1, np.abs(G).max()))
        rate = (8 * (near[0][1] - near[1][1]) - (far[0][1] - far[1][1])) @ v / (12 * e)
        np.testing.assert_allclose(G_rate[:, k], rate, rtol=0, atol=1e-11 * max(1, np.abs(G_rate).max()))


def test_curvature_is_the_difference_of_the_gradients(everything):
    p, q, v = all_relations(everything)
    weight = everything.rng.normal(size=(2, len(p.value)))
    _, _, _, b, J = relation_rows(p, q, v)
    H = curvature(p, len(q), weight, b, J)
    e = 0.05
    for k, unit in enumerate(np.eye(len(q))):

        def slope(s, u=unit):
            return weight @ relation_rows(p, q + s * u, v)[1]

        difference = (8 * (slope(e) - slope(-e)) - (slope(2 * e) - slope(-2 * e))) / (12 * e)
        np.testing.assert_allclose(H[:, :, k], difference, rtol=0, atol=1e-11 * np.abs(H).max())


def test_relations_have_their_geometric_values():
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1.0]])
    i, j = Frame("i"), Frame("j", None, np.array([1.0, 2.0, 3.0]), turn)
    relations = [
        coincidence(i, j, 1),
        dot(i, 0, j, 1),
        offset(j, 0, i),
        distance_squared(i, j),
        *bearing_displacements(i, j),
    ]
    rho = relation_rows(compile_products(relations, {}, {}), np.zeros(0), np.zeros(0))[0]
    along = -np.cos(0.3) - 2 * np.sin(0.3)
    np.testing.assert_allclose(rho, [2.0, -np.sin(0.3), along, 14.0, 1.0, 2.0, 3.0, 0.0, np.sin(0.3)], atol=1e-15)


def test_tilts_of_a_bearing_are_small_right_handed_angles(particles):
    cloud = particles(np.ones(4), np.vstack([np.eye(3), np.zeros(3)]), np.zeros((4, 3, 0)))
    ring = Frame("ring", "inner")
    system = assemble([cloud.rigid("inner")])
    p = compile_products(bearing_displacements(Frame("outer"), ring), {"inner": 0}, {"inner": 12})
    for axis, row in ((1, 3), (2, 4)):
        q, v = state(system, {"inner": Pose(spin=np.eye(3)[axis])})
        _, G, *_ = relation_rows(p, q, v)
        np.testing.assert_allclose(G @ v, np.eye(5)[row], atol=1e-15)
