"""What the estimate says of places that no gauge measured: virtual gauges, the strain and stress of the surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.config.estimate import Field3D
from strainsight.config.gauges import Gauges, NamedGauge
from strainsight.errors import ConfigError
from strainsight.estimation.model import FilterModel, theta_of
from strainsight.estimation.smoother import Smoothed
from strainsight.estimation.update import output_std
from strainsight.fem.affine import Parameter
from strainsight.fem.recovery import facet_strain
from strainsight.fem.stress import surface_model, surface_state
from strainsight.gauges.bonded import BondedEntry, bonded
from strainsight.gauges.rows import channel_rows
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.vtkhdf import VtkHdf, facet_cells, unstructured_grid
from strainsight.records.estimated import VirtualStrain


def virtual_labels(entries: Sequence[NamedGauge]) -> tuple[str, ...]:
    """Names, or "V1", "V2 45°": every grid of `estimate.virtual`."""
    labels = [entry.name or f"V{i + 1}" for i, entry in enumerate(entries)]
    return tuple(
        label if len(entry.angles) == 1 else f"{label} {angle:g}°"
        for label, entry in zip(labels, entries, strict=True)
        for angle in entry.angles
    )


def virtual_strain(
    mesh: Mesh, basis: np.ndarray, entries: Sequence[NamedGauge], gauges: Gauges, smoothed: Smoothed
) -> VirtualStrain | None:
    """The smoothed strain of gauges that are not there, each at the nearest point of the surface; None without one.

    basis (3 nodes, n); entries of `estimate.virtual`; gauges of the config: grid length and snapping tolerance.
    Raises UserError for one off the surface.
    """
    if not entries:
        return None
    facets, q = exterior_facets(mesh), slice(0, basis.shape[1])
    stated = [
        BondedEntry(e.position, e.direction, gauges.grid_length if e.length is None else e.length, e.angles)
        for e in entries
    ]
    pool, _ = bonded(mesh, facets, stated, gauges.snap_tolerance, key="estimate.virtual")
    rows = channel_rows(mesh.position, pool, basis, facets=facets)
    assert smoothed.covariance is not None
    return VirtualStrain(
        strain=smoothed.mean[:, 0, q] @ rows.T,
        std=output_std(rows, smoothed.covariance[:, 0, q, q]),
        position=pool.position,
        direction=pool.direction,
    )


SHOWN = ("strain", "strain_std", "stress", "von_mises", "von_mises_std", "principal")
FRAMES = 100
"""Pictures of the surface where no time between them is stated."""


def surface_in_time(
    mesh: Mesh,
    basis: np.ndarray,
    parameters: Sequence[Parameter],
    model: FilterModel,
    smoothed: Smoothed,
    stated: Field3D,
) -> VtkHdf:
    """Displacement, strain and stress of every exterior facet in time, as a grid with steps; with claimed σ where it is given.

    basis (3 nodes, n); stated: the time between pictures, a hundred of them where it says none. Stress and its σ to first
    order in the coordinates and the estimated moduli. Raises ConfigError where the mesh has no solids.
    """
    if not mesh.blocks:
        raise ConfigError("the mesh has no solids, and so no surface", key="estimate.field", remedy="remove the key")
    facets = exterior_facets(mesh)
    with mesh.located():
        surface = surface_model(mesh, facet_strain(mesh, facets), basis, parameters)
    used, blocks, order = facet_cells(facets)
    step = stated.every or smoothed.time[-1] / FRAMES
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
        state = surface_state(surface, theta, x[:n], P if np.isfinite(P).all() else None, free)
        for name in SHOWN:
            if (shown := getattr(state, name)) is not None:
                data.setdefault(name, []).append(shown[order].astype(np.float32))
    shapes = basis.reshape(len(mesh.position), 3, -1)[used]
    displacement = np.stack([(shapes @ smoothed.mean[k, 0, :n]).astype(np.float32) for k in frames])
    return unstructured_grid(
        mesh.position[used],
        blocks,
        point_data={"displacement": displacement},
        cell_data={name: np.stack(values) for name, values in data.items()},
        steps=smoothed.time[frames],
    )
