"""import and reduce of a bench: the meshes of its flexible bodies, and the bodies reduced after Craig and Bampton."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from strainsight.config.bench.bench import BenchConfig
from strainsight.errors import ConfigError
from strainsight.experiment.bench.reduction import reduce_output
from strainsight.experiment.structure.mesh import checked, mesh_of, model_warnings
from strainsight.experiment.structure.mesh_tables import build_mesh_tables
from strainsight.mesh.model import Mesh
from strainsight.mesh.sanity import size_of
from strainsight.mesh.units import scaled
from strainsight.records.mesh import Meshes
from strainsight.records.record import written
from strainsight.runner.output import Output, Scalar, Table
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench import inputs


def run_import(context: Context[BenchConfig]) -> Output:
    """Read every deck, convert its units, add what the config adds, check it, weigh it."""
    meshes: dict[str, Mesh] = {}
    summary: dict[str, Scalar] = {}
    tables: list[Table] = []
    included: list[Path] = []
    parts = []
    bodies = context.config.flexible
    for i, (name, body) in enumerate(bodies.items()):
        context.progress(name, i / len(bodies))
        key = f"bodies.{name}.mesh"
        deck = mesh_of(body.mesh, context.files[f"{key}.file"], key, context.base, loads=())
        if deck.springs:
            raise ConfigError(
                f"{deck.springs[0]}: a flexible body cannot have springs",
                key=key,
                remedy=f"define the springs in the section `forces`, and ignore those of the deck with `{key}.ignore`",
            )
        if deck.thin:
            raise ConfigError(
                f"the body has {', '.join(block.kind for block in deck.thin)} elements, but a flexible body "
                "supports solids only",
                key=key,
                remedy=f"use solids, or ignore these elements with `{key}.ignore`",
            )
        mesh = meshes[name] = scaled(deck, float(body.scale))
        weight, quality = checked(mesh, body.mesh, key)
        assert weight is not None
        warnings = model_warnings(deck, body.mesh.length_unit, body.mesh.mass_unit)
        tables += [
            replace(table, title=f"{name}: {table.title}")
            for table in build_mesh_tables(mesh, weight, quality, warnings)
        ]
        included += [Path(file) for file in mesh.included]
        summary |= {
            f"nodes.{name}": len(mesh.node_ids),
            f"mass.{name}": float(weight[0]),
            f"extent.{name}": size_of(mesh),
        }
        parts.append(f"{name}: {len(mesh.node_ids)} nodes, {weight[0]:.5g} kg")
    return Output(
        datasets=written(Meshes(bodies=meshes)),
        summary=summary,
        message="; ".join(parts) or "the bench has no flexible bodies",
        tables=tuple(tables),
        inputs=tuple(included),
    )


IMPORT = Stage(
    "import",
    version=14,
    reads=("bodies.*.mesh", "bodies.*.scale"),
    upstream=(),
    files=("bodies.*.mesh.file",),
    run=run_import,
)


def run_reduce(context: Context[BenchConfig]) -> Output:
    """The bodies reduced after Craig and Bampton."""
    return reduce_output(context.config, inputs.meshes(context), context)


REDUCE = Stage(
    "reduce",
    version=8,
    reads=(
        "bodies.*.type",
        "bodies.*.modes",
        "bodies.*.cutoff",
        "bodies.*.damping",
        "bodies.*.moduli",
        "frames.*.body",
        "frames.*.node",
    ),
    upstream=("import",),
    files=(),
    run=run_reduce,
)
