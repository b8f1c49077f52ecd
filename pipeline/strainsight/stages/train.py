"""train: every candidate on the surface, and what each would read under the training load (5.2)."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from strainsight.cases.structure.candidates import OnSurface, candidates_on_surface, zone_of
from strainsight.cases.structure.channels import readings
from strainsight.cases.structure.given_gauges import read_given
from strainsight.cases.structure.scales import refuse_readings, refuse_times
from strainsight.cases.structure.settings import signal_of
from strainsight.decks.matrices.files import read_numbering
from strainsight.errors import ConfigError, blame
from strainsight.fem.memory import require_memory
from strainsight.gauges.candidates import Candidates
from strainsight.gauges.given import without
from strainsight.gauges.rows import channel_rows
from strainsight.measurements.calibration import LARGE_STRAIN
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.units import length_factor
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read, written
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.rom.modal_step import simulate
from strainsight.signals.histories import hold_coefficients, instant_values
from strainsight.workflow.output import Output, Table
from strainsight.workflow.stage import Context, Stage

FEWER = "a shorter training run, a longer time step, or fewer candidates: gauges.include, gauges.exclude, fewer angles"


def run(context: Context) -> Output:
    """Simulate the reduced model at the guess from rest, and read every candidate."""
    config = context.config
    mesh, reduced = mesh_from(context.upstream["import"]), read(Reduced, context.upstream["rom"])
    model = reduced.model
    h = config.train.time_step
    steps = round(config.train.duration / h)
    refuse_times(reduced.frequency, config.train.duration, h)
    with blame("train"):
        signals = [signal_of(name, config.loads[name].signal, context.files) for name in model.inputs]
        held = hold_coefficients(signals, 0.0, h, steps)
    x, u = simulate(model, model.reference, held, h), instant_values(held)
    n = model.size
    context.progress("candidates", 0.3)
    surface, given = None, None
    if config.gauges.given is None:
        basis = reduced.basis
        surface = candidates_on_surface(mesh, config, basis, x[:, :n])
        pool = surface.candidates
        rows = channel_rows(mesh.position, pool, basis, facets=exterior_facets(mesh))
    else:
        pool, given = _given(context, mesh)
        assert reduced.matrices is not None
        rows = given @ reduced.matrices.basis
    moved = np.zeros(0) if surface is None else surface.moved
    with blame("train"):
        # the readings and their squares
        require_memory(16.0 * (steps + 1) * len(rows), f"readings of {len(rows)} channels in {steps} steps", FEWER)
    strain = readings(model, model.reference, rows, pool.quantity, x, u)
    refuse_readings(strain)
    rms = np.sqrt(np.mean(strain**2, axis=0))
    strongest = float(rms[pool.quantity == pool.quantity[0]].max())
    training = Training(
        candidates=pool,
        rows=rows,
        given=given,
        moved=moved if len(moved) else None,
        time=h * np.arange(steps + 1),
        load=u,
        coordinate=x[:, :n],
        velocity=x[:, n:],
        reading=strain,
    )
    return Output(
        datasets=written(training),
        summary={
            "candidates": pool.gauges,
            "left_out": surface.left_out if surface else 0,
            "channels": len(rows),
            "steps": steps,
            "strongest_rms": strongest,
        },
        message=_message(pool, steps, strongest, surface),
        tables=(_glued_table(pool, moved),) if len(moved) else (),
    )


def _message(pool: Candidates, steps: int, strongest: float, surface: OnSurface | None) -> str:
    first = pool.first
    kinds = (
        (pool.array[first] == 0) & ~pool.glued[first],
        pool.glued[first],
        pool.quantity[first] == 1,
        pool.quantity[first] == 2,
    )
    words = ("candidates", "glued", "accelerometers", "displacement sensors")
    counts = ", ".join(f"{kind.sum()} {word}" for kind, word in zip(kinds, words, strict=True) if kind.any())
    said = [counts, f"{steps} steps, strongest RMS {1e6 * strongest:.4g} µm/m"]
    if strongest > LARGE_STRAIN:
        said.append("far from small: are load and modulus in the right unit?")
    if surface is not None and len(surface.moved):
        said.append(f"glued ones moved by up to {1e3 * surface.moved.max():.2g} mm")
    if surface is not None and surface.left_out:
        said.append(f"{surface.left_out} places left out: a grid over a sharp edge")
    if surface is not None and surface.empty:
        said.append(f"no facet in the zone {', '.join(surface.empty)}: is it in metres?")
    return ", ".join(said)


def _glued_table(own: Candidates, moved: np.ndarray) -> Table:
    """Where the glued gauges are; they are the first candidates."""
    rows = tuple(
        (
            f"fixed {i + 1}",
            str(own.element[c]),
            str(own.facet[c]),
            " ".join(f"{x:.4f}" for x in own.position[c]),
            " ".join(f"{round(d, 3) + 0.0:g}" for d in own.direction[c]),
            f"{1e3 * moved[i]:.3g} mm",
        )
        for i, c in enumerate(own.first[: len(moved)])
    )
    return Table(
        "glued gauges, moved to the surface", ("gauge", "element", "facet", "x y z [m]", "direction", "moved by"), rows
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


TRAIN = Stage(
    "train",
    version=3,
    reads=(
        "loads.*.signal",
        "train",
        "gauges.surface",
        "gauges.direction",
        "gauges.rosette",
        "gauges.grid_length",
        "gauges.include",
        "gauges.exclude",
        "gauges.fixed",
        "gauges.snap_tolerance",
        "gauges.given",
        "motion_sensors.*.quantity",
        "motion_sensors.*.surface",
        "motion_sensors.*.axes",
        "motion_sensors.*.every",
        "motion_sensors.*.include",
        "motion_sensors.*.exclude",
        "mesh.length_unit",
        "mesh.matrices",
    ),
    upstream=("import", "rom"),
    files=("loads.*.signal.file", "gauges.given.rows", "gauges.given.table", "mesh.matrices.numbering"),
    run=run,
)
