"""Rows of gauges and their channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import InfeasibleError, UserError
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.kinds import ELEMENTS, FACETS
from strainsight.mesh.model import CellBlock
from strainsight.sensors.candidates import ACCELERATION, DISPLACEMENT, Candidates, candidates, motion_candidates
from strainsight.sensors.strain_operator import channel_rows
from strainsight.sensors.zones import Box

from ..refusals import expect_refusal
from .conftest import bare, misplaced_rows

KINDS = {kind.name: kind for kind in FACETS if not len(kind.read_at)}


def patch(kind: str, bend: float, seed: int = 0, scale: float = 1.0) -> tuple[np.ndarray, Facets]:
    """One facet in the x-y plane (normal +z), its nodes shaken by `bend` of its size in all three directions."""
    plane = KINDS[kind].nodes
    rng = np.random.default_rng(seed)
    position = np.column_stack([plane, np.zeros(len(plane))]) + bend * rng.uniform(-1, 1, (len(plane), 3))
    nodes = np.full((1, 8), -1)
    nodes[0, : len(plane)] = np.arange(len(plane))
    one = np.array([1])
    return scale * position, Facets(
        element_id=one, facet=one, kind=np.array([FACETS.index(KINDS[kind])]), nodes=nodes, region=one
    )


def bonded(position: np.ndarray, facets: Facets, axis=(1.0, 0.2, 0.0), angles=(0.0,)) -> Candidates:
    return candidates(bare(position), facets, axis, angles)


def surface_strain(G: np.ndarray, d: np.ndarray) -> np.ndarray:
    """dᵀ sym(G) d for every direction (m, 3)."""
    return np.einsum("mi,ij,mj->m", d, 0.5 * (G + G.T), d)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bend", [0.0, 0.15])
@pytest.mark.parametrize("seed", range(2))
def test_a_linear_field_is_read_exactly_on_distorted_and_curved_facets(kind, bend, seed):
    position, facets = patch(kind, bend, seed)
    G = np.random.default_rng(seed).standard_normal((3, 3))
    gauges = bonded(position, facets, angles=(0.0, 37.0, 90.0))
    rows = channel_rows(position, gauges, (position @ G.T + 3.0).reshape(-1, 1))
    np.testing.assert_allclose(rows[:, 0], surface_strain(G, gauges.direction), atol=1e-13)


@pytest.mark.parametrize("kind", ["tri6", "quad8"])
def test_quadratic_field_is_exact_on_quadratic_facets(kind):
    """z_c = xᵀQ_c x: the slope along d at x is dᵀ(Q + Qᵀ)x, at the centre and at an offset along (d, n × d)."""
    position, facets = patch(kind, 0.0)
    shear = np.array([[1.3, 0.4, 0.0], [-0.2, 0.8, 0.0], [0.0, 0.0, 1.0]])
    position = position @ shear.T + np.array([0.3, -0.2, 0.0])
    gauges = bonded(position, facets)
    d, n = gauges.direction[0], gauges.normal[0]
    Q = np.random.default_rng(5).standard_normal((3, 3, 3))
    z = np.einsum("ki,cij,kj->kc", position, Q, position)
    for offset in ([0.0, 0.0], [0.07, 0.0], [0.0, -0.06], [-0.05, 0.04]):
        x = gauges.position[0] + offset[0] * d + offset[1] * np.cross(n, d)
        slope = np.einsum("i,cij,j->c", d, Q + np.swapaxes(Q, 1, 2), x)
        rows = misplaced_rows(position, gauges, z.reshape(-1, 1), offset=np.array([offset]))
        np.testing.assert_allclose(rows[0, 0], slope @ d, atol=1e-12)


@pytest.mark.parametrize("kind", ELEMENTS, ids=lambda kind: kind.name)
def test_facet_strain_equals_solid_strain(kind):
    """Oracle: ∇z of the whole element by its own volume shape functions, at the centre of each of its facets."""
    reference = kind.nodes
    rng = np.random.default_rng(6)
    position = reference + 0.04 * rng.uniform(-1, 1, reference.shape)
    block = CellBlock(kind.name, np.array([7]), np.arange(len(reference))[None], np.array([1]))
    mesh = replace(bare(position), blocks=(block,))
    facets = exterior_facets(mesh)
    gauges = candidates(mesh, facets, (0.5, 0.3, 0.81), (20.0, 110.0))
    z = rng.standard_normal(position.shape)
    rows = channel_rows(position, gauges, z.reshape(-1, 1))[:, 0]
    assert len(gauges) == 2 * len(kind.facets)
    for i in range(len(gauges)):
        facet, local = kind.facets[gauges.facet[i] - 1]
        slope = kind.gradient(reference[list(local[: facet.corners])].mean(axis=0))[0]
        gradient = (z.T @ slope) @ np.linalg.inv(position.T @ slope)
        d = gauges.direction[i]
        assert rows[i] == pytest.approx(d @ gradient @ d, abs=1e-11)


def test_a_triaxial_sensor_on_a_body_in_motion_reads_the_motion_of_its_point(box_mesh):
    facets = exterior_facets(box_mesh)
    axes = ("normal", (1, 1, 0), (0, 0, -2))
    sensors = motion_candidates(box_mesh, facets, DISPLACEMENT, axes, on_constraints=True)
    shift, spin = np.random.default_rng(0).standard_normal((2, 3))
    z = shift + np.cross(spin, box_mesh.position)
    read = channel_rows(box_mesh.position, sensors, z.reshape(-1, 1))[:, 0].reshape(-1, 3)
    here = sensors.position[::3]
    motion = shift + np.cross(spin, here)
    normal = sensors.normal[::3]
    expected = [np.sum(motion * normal, axis=1), motion @ [np.sqrt(0.5), np.sqrt(0.5), 0], -motion[:, 2]]
    np.testing.assert_allclose(read, np.column_stack(expected), atol=1e-12)
    middle = box_mesh.position.mean(axis=0)
    assert np.all(np.sum((here - middle) * normal, axis=1) > 0)


@pytest.mark.parametrize("every", [0.09, 0.2, 0.33])
def test_motion_sensor_spacing(every, box_mesh):
    facets = exterior_facets(box_mesh)
    whole = motion_candidates(box_mesh, facets, ACCELERATION)
    thin = motion_candidates(box_mesh, facets, ACCELERATION, every=every)
    gap = np.linalg.norm(thin.position[:, None] - thin.position, axis=2) + 10 * np.eye(len(thin))
    assert gap.min() >= every * (1 - 1e-6)
    reach = np.linalg.norm(whole.position[:, None] - thin.position, axis=2).min(axis=1)
    assert reach.max() < every


def test_an_axis_of_no_length_is_refused(box_mesh):
    with expect_refusal(UserError, "sensor axis", key="motion_sensors.top.axes"):
        motion_candidates(box_mesh, exterior_facets(box_mesh), ACCELERATION, ((0, 0, 0),), key="motion_sensors.top")


def test_zones_to_include_are_together_one(box_mesh):
    facets = exterior_facets(box_mesh)
    left, right = Box((0, -1, -1), (0.3, 1, 1)), Box((0.8, -1, -1), (2, 1, 1))
    every = candidates(box_mesh, facets, (1, 0, 0))
    inner = candidates(box_mesh, facets, (1, 0, 0), include=(left, right))
    x = every.position[:, 0]
    np.testing.assert_array_equal(inner.position, every.position[(x <= 0.3) | (x >= 0.8)])
    both = candidates(box_mesh, facets, (1, 0, 0), include=(left, right), exclude=(left,))
    assert both.position[:, 0].min() > 0.8


NOWHERE, EVERYWHERE = Box((5, 5, 5), (6, 6, 6)), Box((-1, -1, -1), (2, 2, 2))


@pytest.mark.parametrize(
    ("arguments", "key", "count"),
    [
        ({"surface": "lonely"}, "gauges.surface", "step: 112 exterior facets, 0 facets on the surface 'lonely'"),
        ({"include": (NOWHERE, NOWHERE)}, "gauges.include", "removes the last 80 facets"),
        (
            {"exclude": (NOWHERE, EVERYWHERE)}, "gauges.exclude.1",
            "80 facets outside gauges.exclude.0, 0 facets outside gauges.exclude.1",
        ),
        ({"include": (EVERYWHERE,), "exclude": (EVERYWHERE,)}, "gauges.exclude.0", "80 facets in the zones of gauges.include"),
    ],
)
def test_step_without_remaining_facet_is_reported(arguments, key, count, box_mesh):
    with expect_refusal(InfeasibleError, "no admissible facet remains", key=key) as caught:
        candidates(box_mesh, exterior_facets(box_mesh), (1, 0, 0), **arguments)
    assert count in caught.value.what


def test_facets_on_supports_alone_name_the_surface(box_mesh):
    with pytest.raises(InfeasibleError, match=r"6 facets on the surface 'root', .*, 0 facets without constrained") as e:
        motion_candidates(box_mesh, exterior_facets(box_mesh), ACCELERATION, surface="root", key="motion_sensors.a")
    assert e.value.key == "motion_sensors.a.surface"
