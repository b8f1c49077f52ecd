"""Displacement, strain and stress of a flexible body's surface during a bench run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.config.bench.bench import BenchConfig, SurfaceField
from strainsight.errors import InfeasibleError
from strainsight.experiment.bench.reduction import flexible, moduli_of
from strainsight.experiment.resources import Resources
from strainsight.fem.recovery import facet_strain
from strainsight.fem.stress import surface_model, surface_state
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.vtkhdf import VtkHdf, facet_cells, unstructured_grid
from strainsight.multibody.bodies import RIGID
from strainsight.ordering import first_of_largest
from strainsight.records.bodies import ReducedBody
from strainsight.records.simulated import SurfaceInTime

PICTURES = 50


@dataclass(frozen=True)
class Motion:
    """time (T,) [s]; q (T, coordinates of the body); moduli (T,) [Pa]: those that were estimated."""

    time: np.ndarray
    q: np.ndarray
    moduli: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Pictures:
    """facets: how many; worst: number of the picture of the largest stress, element: where."""

    found: SurfaceInTime
    grid: VtkHdf
    facets: int
    worst: int
    element: int


def pictures(config: BenchConfig, mesh: Mesh, reduced: ReducedBody, motion: Motion, using: Resources) -> Pictures:
    """The surface at some instants: displacement and strain in body axes, stress with the moduli of those instants."""
    settings = config.field
    assert settings is not None
    time, q, modes = motion.time, motion.q, len(reduced.mass)
    at = instants(len(time), settings)
    if not np.isfinite(q[at]).all():
        lost = time[at][~np.isfinite(q[at]).all(axis=1)][0]
        raise InfeasibleError(
            f"the estimate diverged, at {lost:g} s at the latest: there is no field from there on",
            key="field.of",
            remedy="correct the estimate, or set field.of: simulate",
        )
    parameters = moduli_of(settings.body, flexible(config)[settings.body].moduli, mesh)
    theta = {p.name: motion.moduli.get(p.name, np.full(len(time), p.reference))[at] for p in parameters}
    facets = exterior_facets(mesh)
    with mesh.located():
        surface = surface_model(mesh, facet_strain(mesh, facets), reduced.basis, parameters)
    used, blocks, order = facet_cells(facets)
    data: dict[str, list[np.ndarray]] = {key: [] for key in ("strain", "stress", "von_mises", "principal")}
    for i, k in enumerate(at):
        using.progress("pictures", i / len(at))
        now = {key: float(values[i]) for key, values in theta.items()}
        state = surface_state(surface, now, q[k, q.shape[1] - modes :])
        for key, values in data.items():
            values.append(getattr(state, key)[order].astype(np.float32))
    shapes = reduced.basis.reshape(len(mesh.position), 3, -1)[used]
    grid = unstructured_grid(
        mesh.position[used],
        blocks,
        point_data=points(mesh.position[used], shapes, q[at], modes),
        cell_data={key: np.stack(values) for key, values in data.items()},
        steps=time[at],
    )
    mises = np.stack(data["von_mises"])
    worst, where = np.unravel_index(first_of_largest(mises.astype(float).ravel()), mises.shape)
    found = SurfaceInTime(time=time[at], von_mises=mises.max(axis=1), moduli=theta)
    return Pictures(found, grid, len(order), int(worst), int(facets.element_id[order][where]))


def instants(count: int, settings: SurfaceField) -> np.ndarray:
    """Steps of the pictures, of so many."""
    if settings.every is not None:
        return np.arange(0, count, settings.every)
    wanted = PICTURES if settings.instants is None else settings.instants
    return np.unique(np.linspace(0, count - 1, wanted).astype(int))


def points(x: np.ndarray, shapes: np.ndarray, q: np.ndarray, modes: int) -> dict[str, np.ndarray]:
    """Φη in body axes, and of a body that moves p − x = r + R(x + Φη) − x in global ones: pictures × points × xyz.

    x (n, 3) [m]; shapes Φ (n, 3, modes); q (pictures, coordinates of the body).
    """
    u = np.einsum("nck,tk->tnc", shapes, q[:, q.shape[1] - modes :])
    found = {"displacement": u.astype(np.float32)}
    if q.shape[1] > modes:
        R = q[:, 3:RIGID].reshape(-1, 3, 3)  # its columns, one a row
        found["motion"] = (q[:, None, :3] + np.einsum("tnc,tcd->tnd", x + u, R) - x).astype(np.float32)
    return found
