"""train: every candidate gauge on the surface, and what each would read under the training load (5.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy import sparse

from strainsight.decks.matrices.files import read_numbering
from strainsight.errors import ConfigError, blame
from strainsight.gauges.candidates import Candidates, candidates
from strainsight.gauges.given import without
from strainsight.gauges.rows import strain_rows
from strainsight.gauges.zones import Box, Cylinder, NearEdges, NearSet, NormalCone, Zone
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.units import length_factor
from strainsight.rom.modal_step import simulate
from strainsight.signals.histories import hold_coefficients, instant_values
from strainsight.stages.case.given_gauges import read_given
from strainsight.stages.case.settings import signal_of
from strainsight.stages.records.gauges import candidate_datasets, given_datasets
from strainsight.stages.records.mesh import mesh_from
from strainsight.stages.records.model import model_from
from strainsight.workflow.output import Dataset, Output
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """Simulate the reduced model at the guess from rest, and read the strain of every candidate."""
    config = context.config
    mesh, rom = mesh_from(context.upstream["import"]), context.upstream["rom"]
    model = model_from(rom)
    if config.gauges.given is None:
        pool, given = _on_surface(mesh, config), None
        rows = strain_rows(mesh.position, pool, rom["/basis"])
    else:
        pool, given = _given(context, mesh)
        rows = given @ rom["/matrices/basis"]
    h = config.train.time_step
    steps = round(config.train.duration / h)
    with blame("train"):
        signals = [signal_of(name, config.loads[name].signal, context.files) for name in model.inputs]
        held = hold_coefficients(signals, 0.0, h, steps)
    x = simulate(model, model.reference, held, h)
    strain = x[:, : model.size] @ rows.T
    strongest = float(np.sqrt(np.mean(strain**2, axis=0)).max())
    n = model.size
    return Output(
        datasets=candidate_datasets(pool)
        | ({} if given is None else given_datasets(given))
        | {
            "/time": Dataset(h * np.arange(steps + 1), "s", "time of the training run"),
            "/input": Dataset(instant_values(held), "N", "training load (time × input)", ("/time", "")),
            "/coordinate": Dataset(x[:, :n], "kg^1/2 m", "reduced coordinates q (time × coordinate)", ("/time", "")),
            "/velocity": Dataset(x[:, n:], "kg^1/2 m/s", "reduced velocities (time × coordinate)", ("/time", "")),
            "/strain": Dataset(strain, "strain", "strain of every candidate (time × candidate)", ("/time", "")),
            "/gauges/row": Dataset(rows, "strain/(kg^1/2 m)", "strain per reduced coordinate (candidate × coordinate)"),
        },
        summary={"candidates": len(rows), "steps": steps, "strongest_rms": strongest},
        message=f"{len(rows)} candidates, {steps} steps, strongest RMS {1e6 * strongest:.4g} µm/m",
    )


def _on_surface(mesh: Mesh, config: Any) -> Candidates:
    if not mesh.blocks:
        raise ConfigError(
            "the mesh has no solids, and so no surface",
            key="gauges.surface",
            remedy="give mesh.matrices and gauges.given: strain rows of the gauges",
        )
    facets = exterior_facets(mesh)
    with blame("gauges.surface"):
        return candidates(
            mesh,
            facets,
            config.gauges.direction.axis,
            config.gauges.direction.angles,
            exclude=[zone_of(entry) for entry in config.gauges.exclude],
            surface=config.gauges.surface,
        )


def _given(context: Context, mesh: Mesh) -> tuple[Candidates, sparse.csr_array]:
    """Gauges by their strain rows, without those in excluded zones."""
    gauges = context.config.gauges
    if gauges.surface != "all":
        raise ConfigError(
            "given gauges lie on no surface of the mesh", key="gauges.surface", remedy="remove the key, or gauges.given"
        )
    _, components = read_numbering(context.files["mesh.matrices.numbering"])
    with blame("gauges.given"):
        given = read_given(
            context.files["gauges.given.rows"],
            context.files["gauges.given.table"],
            components,
            length_factor(context.config.mesh.length_unit),
        )
    with blame("gauges.exclude"):
        facets = exterior_facets(mesh) if mesh.blocks else None
        given = without(given, mesh, facets, [zone_of(entry) for entry in gauges.exclude])
    return given.pool, given.rows


def zone_of(entry: Mapping[str, Any]) -> Zone:
    """A zone of `gauges.exclude`."""
    (kind, value), *_ = entry.items()
    match kind:
        case "box":
            return Box(*value)
        case "cylinder":
            return Cylinder(value.point, value.axis, value.radius)
        case "normal_cone":
            return NormalCone(value.axis, value.angle)
        case "near_set":
            return NearSet(value.set, value.distance)
    return NearEdges(float(value))


TRAIN = Stage(
    "train",
    version=2,
    reads=(
        "loads.*.signal",
        "train",
        "gauges.surface",
        "gauges.direction",
        "gauges.exclude",
        "gauges.given",
        "mesh.length_unit",
        "mesh.matrices",
    ),
    upstream=("import", "rom"),
    files=("loads.*.signal.file", "gauges.given.rows", "gauges.given.table", "mesh.matrices.numbering"),
    run=run,
)
