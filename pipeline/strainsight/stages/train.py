"""train: every candidate gauge on the surface, and what each would read under the training load (5.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from strainsight.errors import blame
from strainsight.gauges.candidates import Box, NearEdges, Zone, candidates
from strainsight.gauges.rows import strain_rows
from strainsight.mesh.facets import exterior_facets
from strainsight.rom.modal_step import simulate
from strainsight.signals.histories import hold_coefficients, instant_values
from strainsight.stages.case.settings import signal_of
from strainsight.stages.records.gauges import candidate_datasets
from strainsight.stages.records.mesh import mesh_from
from strainsight.stages.records.model import model_from
from strainsight.workflow.output import Dataset, Output
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """Simulate the reduced model at the guess from rest, and read the strain of every candidate."""
    config = context.config
    mesh, rom = mesh_from(context.upstream["import"]), context.upstream["rom"]
    model = model_from(rom)
    facets = exterior_facets(mesh)
    with blame("gauges.surface"):
        pool = candidates(
            mesh,
            facets,
            config.gauges.direction.axis,
            config.gauges.direction.angles,
            exclude=[_zone(entry) for entry in config.gauges.exclude],
            surface=config.gauges.surface,
        )
    rows = strain_rows(mesh.position, pool, rom["/basis"])
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


def _zone(entry: Mapping[str, Any]) -> Zone:
    return Box(*entry["box"]) if "box" in entry else NearEdges(float(entry["near_edges"]))


TRAIN = Stage(
    "train",
    version=1,
    reads=("loads.*.signal", "train", "gauges.surface", "gauges.direction", "gauges.exclude"),
    upstream=("import", "rom"),
    files=("loads.*.signal.file",),
    run=run,
)
