"""field: displacement, strain and stress of a flexible body's surface during a bench run, as a grid that ParaView plays."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from strainsight.cases.bench.reduction import moduli_of
from strainsight.errors import InfeasibleError
from strainsight.fem.affine import Parameter
from strainsight.fem.recovery import facet_strain
from strainsight.fem.stress import surface_model, surface_state
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.vtkhdf import facet_cells, unstructured_grid
from strainsight.multibody.bodies import RIGID
from strainsight.records.grids import vtkhdf_datasets
from strainsight.stages.bench import inputs
from strainsight.workflow.output import Dataset, Output, Scalar
from strainsight.workflow.stage import Context, Stage

PICTURES = 50
UNITS = {
    "PointData/displacement": "m",
    "PointData/motion": "m",
    "CellData/strain": "1",
    "CellData/stress": "Pa",
    "CellData/von_mises": "Pa",
    "CellData/principal": "Pa",
}


def run(context: Context) -> Output:
    """The surface at some instants: displacement and strain in body axes, stress with the moduli of those instants."""
    config, settings = context.config, context.config.field
    name, source = settings.body, context.upstream[settings.of]
    mesh, reduced = inputs.meshes(context)[name], inputs.bodies(context)[name]
    time, q = source["/time"], source["/q"]
    first, stop = (int(i) for i in context.upstream["simulate"][f"/coordinates/{name}"])
    modes = len(reduced.mass)
    at = _instants(len(time), settings)
    if not np.isfinite(q[at]).all():
        lost = time[at][~np.isfinite(q[at]).all(axis=1)][0]
        raise InfeasibleError(
            f"the estimate was lost, at {lost:g} s at the latest: there is no field from there on",
            key="field.of",
            remedy="mend the estimate, or set field.of: simulate",
        )
    parameters = moduli_of(name, config.bodies[name].moduli, mesh)
    theta = {p.name: _values(source, p, len(time))[at] for p in parameters}
    facets = exterior_facets(mesh)
    with mesh.located():
        surface = surface_model(mesh, facet_strain(mesh, facets), reduced.basis, parameters)
    used, blocks, order = facet_cells(facets)
    data: dict[str, list[np.ndarray]] = {key: [] for key in ("strain", "stress", "von_mises", "principal")}
    for i, k in enumerate(at):
        context.progress("pictures", i / len(at))
        now = {key: float(values[i]) for key, values in theta.items()}
        state = surface_state(surface, now, q[k, stop - modes : stop])
        for key, values in data.items():
            values.append(getattr(state, key)[order].astype(np.float32))
    points = _points(
        mesh.position[used], reduced.basis.reshape(len(mesh.position), 3, -1)[used], q[at, first:stop], modes
    )
    grid, attributes = vtkhdf_datasets(
        unstructured_grid(
            mesh.position[used],
            blocks,
            point_data=points,
            cell_data={key: np.stack(values) for key, values in data.items()},
            steps=time[at],
        )
    )
    attributes |= {f"/VTKHDF/{path}": {"units": unit} for path, unit in UNITS.items() if f"/VTKHDF/{path}" in grid}
    mises = np.stack(data["von_mises"])
    worst, where = np.unravel_index(int(np.argmax(mises)), mises.shape)
    element = facets.element_id[order][where]
    summary: dict[str, Scalar] = {
        "pictures": len(at),
        "facets": len(order),
        "von_mises": float(mises.max()),
        "time": float(time[at][worst]),
        "element": int(element),
    }
    return Output(
        datasets=grid
        | {
            "/time": Dataset(time[at], "s", "instants of the pictures"),
            "/von_mises": Dataset(mises.max(axis=1), "Pa", "largest von Mises stress of every picture", ("/time",)),
        }
        | {
            f"/moduli/{key}": Dataset(values, "Pa", f"Young's modulus {key} that the stress is of", ("/time",))
            for key, values in theta.items()
        },
        attributes=attributes,
        summary=summary,
        message=f"{name}: {len(at)} pictures of {len(order)} facets, at most {mises.max() / 1e6:.4g} MPa von Mises at "
        f"t = {time[at][worst]:.4g} s in element {element}",
    )


def _instants(count: int, settings: Any) -> np.ndarray:
    if settings.every is not None:
        return np.arange(0, count, int(settings.every))
    return np.unique(
        np.linspace(0, count - 1, PICTURES if settings.instants is None else int(settings.instants)).astype(int)
    )


def _values(source: Any, parameter: Parameter, count: int) -> np.ndarray:
    """A modulus in time (count,) [Pa]: as estimated, where it was."""
    estimated = f"/parameters/{parameter.name}/estimate"
    return np.asarray(source[estimated]) if estimated in source else np.full(count, parameter.reference)


def _points(x: np.ndarray, shapes: np.ndarray, q: np.ndarray, modes: int) -> dict[str, np.ndarray]:
    """Φη in body axes, and of a body that moves p − x = r + R(x + Φη) − x in global ones: pictures × points × xyz.

    x (n, 3) [m]; shapes Φ (n, 3, modes); q (pictures, coordinates of the body).
    """
    u = np.einsum("nck,tk->tnc", shapes, q[:, q.shape[1] - modes :])
    points = {"displacement": u.astype(np.float32)}
    if q.shape[1] > modes:
        R = q[:, 3:RIGID].reshape(-1, 3, 3)  # its columns, one a row
        points["motion"] = (q[:, None, :3] + np.einsum("tnc,tcd->tnd", x + u, R) - x).astype(np.float32)
    return points


FIELD = Stage(
    "field",
    version=1,
    reads=("field", "bodies.*.moduli"),
    upstream=("import", "reduce", "simulate"),
    files=(),
    run=run,
)


def field_stage(of: str) -> Stage:
    """The stage for `field.of`: an estimated motion is read from estimate.h5."""
    return FIELD if of == "simulate" else replace(FIELD, upstream=(*FIELD.upstream, "estimate"))
