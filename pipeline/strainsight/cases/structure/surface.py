"""What the estimate says of places that no gauge measured: virtual gauges, the strain and stress of the surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from strainsight.cases.structure.settings import parameters_of
from strainsight.errors import ConfigError
from strainsight.estimation.model import FilterModel, theta_of
from strainsight.estimation.smoother import Smoothed
from strainsight.estimation.update import output_std
from strainsight.fem.recovery import facet_strain
from strainsight.fem.stress import surface_model, surface_state
from strainsight.gauges.glued import GluedEntry, glued
from strainsight.gauges.rows import channel_rows
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.vtkhdf import facet_cells, unstructured_grid
from strainsight.records.grids import vtkhdf_datasets
from strainsight.workflow.output import Dataset
from strainsight.workflow.stage import Context


@dataclass(frozen=True)
class Virtual:
    """labels (v,) "V1", "V2 45°"; mean, std (T + 1, v) strain; position, direction (v, 3) [m], [-]."""

    labels: tuple[str, ...]
    mean: np.ndarray
    std: np.ndarray
    position: np.ndarray
    direction: np.ndarray


@dataclass(frozen=True)
class FieldInTime:
    """The surface in time as a /VTKHDF group: datasets and attributes."""

    datasets: dict[str, Dataset]
    attributes: dict[str, dict[str, Any]]


def virtual_gauges(
    mesh: Mesh, basis: np.ndarray, entries: Sequence[Any], gauges: Any, smoothed: Smoothed, q: slice
) -> Virtual:
    """The smoothed strain of gauges that were never glued, each at the nearest point of the surface.

    basis (3 nodes, n); entries of `estimate.virtual`; gauges of the config: grid length and snapping tolerance; q: where
    the coordinates stand in x*. Raises UserError for one off the surface.
    """
    if not entries:
        empty = np.zeros((len(smoothed.time), 0))
        return Virtual((), empty, empty, np.zeros((0, 3)), np.zeros((0, 3)))
    facets = exterior_facets(mesh)
    stated = [
        GluedEntry(e.position, e.direction, float(gauges.grid_length if e.length is None else e.length), e.angles)
        for e in entries
    ]
    pool, _ = glued(mesh, facets, stated, float(gauges.snap_tolerance), key="estimate.virtual")
    rows = channel_rows(mesh.position, pool, basis, facets=facets)
    assert smoothed.covariance is not None
    single = [len(entry.angles) == 1 for entry in stated]
    labels = tuple(
        f"V{g + 1}" if single[g] else f"V{g + 1} {angle:g}°" for g, angle in zip(pool.gauge, pool.angle, strict=True)
    )
    return Virtual(
        labels,
        smoothed.mean[:, 0, q] @ rows.T,
        output_std(rows, smoothed.covariance[:, 0, q, q]),
        pool.position,
        pool.direction,
    )


FRAMES = 100
"""Pictures of the surface where no time between them is stated."""


def field_in_time(
    context: Context, mesh: Mesh, basis: np.ndarray, model: FilterModel, smoothed: Smoothed, every: float | None
) -> FieldInTime:
    """Displacement, strain and stress of every exterior facet in time, each with what the filter claims, as a grid with steps.

    basis (3 nodes, n); every [s] between pictures, None for a hundred of them. Stress and its σ to first order in the
    coordinates and the estimated moduli. Raises ConfigError where the mesh has no solids.
    """
    if not mesh.blocks:
        raise ConfigError("the mesh has no solids, and so no surface", key="estimate.field", remedy="remove the key")
    config, facets = context.config, exterior_facets(mesh)
    parameters = parameters_of(config.parameters, mesh, context.files, config.mesh.matrices)
    with mesh.located():
        surface = surface_model(mesh, facet_strain(mesh, facets), basis, parameters)
    used, blocks, order = facet_cells(facets)
    step = smoothed.time[-1] / FRAMES if every is None else float(every)
    frames = np.unique(np.round(np.arange(0, smoothed.time[-1] + 0.5 * step, step) / model.h).astype(int))
    frames = frames[frames < len(smoothed.time)]
    n, free = model.model.size, model.unknowns.parameters
    at = np.concatenate([np.arange(n), np.arange(model.parameter_states.start, model.size)])
    data: dict[str, list[np.ndarray]] = {}
    assert smoothed.covariance is not None
    for k in frames:
        x = smoothed.mean[k, 0]
        theta = {name: float(value) for name, value in theta_of(model, x[: model.size]).items()}
        # θ = guess exp(p): to first order its covariance is that of p times θ.
        scale = np.concatenate([np.ones(n), [theta[name] for name in free]])
        P = smoothed.covariance[k, 0][np.ix_(at, at)] * np.outer(scale, scale)
        state = surface_state(surface, theta, x[:n], P, free)
        assert state.strain_std is not None
        assert state.von_mises_std is not None
        for name, values in (
            ("strain", state.strain),
            ("strain_std", state.strain_std),
            ("stress", state.stress),
            ("von_mises", state.von_mises),
            ("von_mises_std", state.von_mises_std),
            ("principal", state.principal),
        ):
            data.setdefault(name, []).append(values[order].astype(np.float32))
    shapes = basis.reshape(len(mesh.position), 3, -1)[used]
    displacement = np.stack([(shapes @ smoothed.mean[k, 0, :n]).astype(np.float32) for k in frames])
    grid = unstructured_grid(
        mesh.position[used],
        blocks,
        point_data={"displacement": displacement},
        cell_data={name: np.stack(values) for name, values in data.items()},
        steps=smoothed.time[frames],
    )
    return FieldInTime(*vtkhdf_datasets(grid))
