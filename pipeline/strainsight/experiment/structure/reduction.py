"""The whole finite-element model of a structure (assembled, from ready matrices or from results), its modes, and its reduction to
a few coordinates, affine in the parameters (5.1-5.10)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from strainsight.config.loads import LoadSection
from strainsight.config.mesh import Matrices, MeshFile
from strainsight.config.placement import PlacementConfig, Train
from strainsight.contrib.mpi.session import OverMpi
from strainsight.errors import DeckError, InfeasibleError, UserError, blame
from strainsight.experiment.recorded import damping_of
from strainsight.experiment.structure.references import (
    damping_parameter,
    load_shapes,
    load_slopes,
    parameters_of,
    places_of,
    point_loads,
)
from strainsight.experiment.structure.results import model_of_results
from strainsight.experiment.structure.training import refuse_damping
from strainsight.experiment.system import Resources
from strainsight.fem.affine import DAMPING, Parameter, at_their_references
from strainsight.fem.factorisation import Factorise, factorise, relief_of
from strainsight.fem.loads import misalignment_shapes
from strainsight.fem.model import FiniteElementModel, FullModel, build_model, nodal
from strainsight.fem.modes import modes as lowest_modes
from strainsight.foreign.matrices.files import NOTED, read_matrix, read_numbering, symmetric
from strainsight.foreign.ready import ReadyMatrices, Term, build_ready_model, ready_matrices
from strainsight.memory import available_memory
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import OF_MASS, shapes, with_value
from strainsight.mesh.units import length_factor, mass_factor
from strainsight.parallel import Sweep, in_threads, serial, threads, watched
from strainsight.processes import peak_memory
from strainsight.records.reduced import FromResults, Misaligned, Modes, ReadyBasis, Reduced, ReductionErrors
from strainsight.records.training import Training
from strainsight.rom.model import quasi_static
from strainsight.rom.reduction import held_out_errors, held_out_samples, only_scales, reduce_model

READS = ("mesh.length_unit", "mesh.mass_unit", "mesh.matrices", "mesh.free", "mesh.results", "solver")
FILES = (
    *("mesh.matrices.numbering", "mesh.matrices.stiffness.*.file", "mesh.matrices.mass.*.file"),
    *("mesh.results.file", "mesh.results.modes.file", "mesh.results.loads.*.file"),
    *("mesh.results.second.file", "mesh.results.second.modes.file", "mesh.results.second.loads.*.file"),
)
"""What a stage that calls `full_model` declares."""


def full_model(
    config: MeshFile,
    mesh: Mesh,
    parameters: Sequence[Parameter],
    files: Mapping[str, Path],
    loads: Mapping[str, LoadSection] | None = None,
    by: Factorise = factorise,
) -> FullModel:
    """Assemble, or read matrices where `mesh.matrices` says so, or results where `mesh.results` does; constrained and affine in
    the parameters in any case. The mesh of an assembled model and of one from results has the densities and sections of the
    parameters' references.

    config: the section `mesh`, of which READS are read; loads: those whose static responses results are read for; by: who
    factorises its stiffness.
    """
    if config.results is not None:
        full = model_of_results(config, mesh, parameters, files, loads)
        full = replace(full, model=_with_densities(full.model, parameters))
    elif config.matrices is None:
        with blame("mesh.file"), mesh.located():
            full = FullModel(_with_densities(build_model(mesh, parameters, free=config.free), parameters))
        if config.free:
            _whole_mass(full.model)
    else:
        ready, notes = _read(config.matrices, config, files)
        with blame("mesh.matrices.numbering"), mesh.located():
            full = build_ready_model(mesh, ready)
        full = replace(full, notes=(*notes, *full.notes))
    return replace(full, model=replace(full.model, factorise=by))


def _with_densities(model: FiniteElementModel, parameters: Sequence[Parameter]) -> FiniteElementModel:
    """Loads that act on mass are those of the mass at the reference."""
    for parameter in parameters:
        known = parameter.property != "density" or all(
            model.mesh.density_of(number) is not None for number in parameter.regions
        )
        if parameter.property in OF_MASS and known:
            model = replace(
                model, mesh=with_value(model.mesh, parameter.property, parameter.regions, parameter.reference)
            )
    return model


def _whole_mass(model: FiniteElementModel) -> None:
    """Raises UserError where densities vary that do not scale the whole mass: rigid and elastic motions of a free structure are
    orthogonal in M at one density of its parts only."""
    if len(model.mass.terms) > 1 or (model.mass.terms and abs(model.mass.constant).sum() > 0):
        name = model.mass.parameters[0]
        raise UserError(
            "the density of a part of a free structure is unknown: its rigid motions would change with it",
            key=f"parameters.{name}",
            remedy="give a density of all regions, without point masses, or hold the structure on soft springs (mesh.supports)",
        )


def _read(matrices: Matrices, config: MeshFile, files: Mapping[str, Path]) -> tuple[ReadyMatrices, list[str]]:
    with blame("mesh.matrices.numbering"):
        path = files["mesh.matrices.numbering"]
        node_ids, components = read_numbering(path)
    notes: list[str] = []
    terms: dict[str, list[Term]] = {"stiffness": [], "mass": []}
    for kind, entries in (("stiffness", matrices.stiffness), ("mass", matrices.mass)):
        for i, entry in enumerate(entries):
            key = f"mesh.matrices.{kind}.{i}.file"
            with blame(key):
                X = read_matrix(files[key], entry.name)
                if X.shape != (len(node_ids),) * 2:
                    raise DeckError(
                        f"the matrix has {X.shape[0]} rows and {X.shape[1]} columns, {path.name} numbers {len(node_ids)}",
                        where=str(files[key]),
                        remedy="give the matrix and the numbering of one and the same set",
                    )
                X, off = symmetric(X, files[key])
            if off > NOTED:
                notes.append(
                    f"{files[key].name} is off symmetry by {off:.1e} of its largest entry and is made symmetric"
                )
            terms[kind].append(Term(X, entry.parameter, 1.0 if entry.at is None else entry.at))
    with blame("mesh.matrices"):
        ready = ready_matrices(
            node_ids,
            components,
            terms["stiffness"],
            terms["mass"],
            length_factor(config.length_unit),
            mass_factor(config.mass_unit),
            str(path),
        )
    return ready, notes


def solver_of(config: PlacementConfig, using: Resources) -> Factorise:
    """PARDISO here, or MUMPS in the processes of MPI."""
    return factorise if config.solver == "direct" else OverMpi(using.notice)


def sweep_of(config: PlacementConfig, using: Resources) -> Sweep:
    """Of samples that are factorised each: in threads, as the solver is compiled and a model is large to send; on a cluster where
    there is one; one after the other where every one of them has the processes of MPI."""
    if config.solver != "direct":
        return serial
    return in_threads(_fitting) if threads() > 1 else using.sweep


def _fitting() -> int:
    """How many at a time: of each as much beside what there is as this process has held at most, a factor included, as the
    reference is factorised before a sweep begins."""
    return min(threads(), max(1, int(available_memory() / (peak_memory() or 1))))


HELD_OUT = 3
"""Parameter values, between those the basis was built from, at which the reduced model is checked."""

NO_MODES = Modes(frequency=np.zeros(0), shape=np.zeros((0, 0)))
"""What a spectrum is where shapes change with the parameters."""

BALANCED = 1e-9
"""Share of a load beside its inertia below which it is rounding."""


def modes_of(config: PlacementConfig, mesh: Mesh, using: Resources) -> Modes:
    """K φ = ω² M φ of the whole model at the guess, whatever loads it."""
    parameters = parameters_of(config.parameters, mesh, using.files, config.mesh)
    return _lowest(config, mesh, at_their_references(parameters), config.rom.modes, "rom.modes", using)


def spectrum_of(config: PlacementConfig, mesh: Mesh, using: Resources) -> Modes:
    """K φ = ω² M φ in the middle of the parameters' ranges, whatever is guessed or true: runs on one mesh share the result.

    Empty where shapes change with them, as of two materials or of plies: `validate` then solves for the truth at its own values.
    """
    count, parameters = config.validation.truth.modes, _in_the_middle(config, mesh)
    if any(shapes(mesh, number, parameter.property) for parameter in parameters for number in parameter.regions):
        return NO_MODES  # K is no multiple of one matrix, which need not be assembled to say so
    return _lowest(config, mesh, parameters, count, "validate.truth.modes", using, scaled=True)


def _lowest(
    config: PlacementConfig,
    mesh: Mesh,
    parameters: tuple[Parameter, ...],
    count: int,
    key: str,
    using: Resources,
    scaled: bool = False,
) -> Modes:
    """Assemble, constrain, factorise, iterate. scaled: only where the parameters scale one material as a whole."""
    using.progress("assembly", 0.0)
    built = full_model(config.mesh, mesh, parameters, using.files, by=solver_of(config, using))
    model = built.model
    if scaled and not only_scales(model):
        return NO_MODES
    theta = {p.name: p.reference for p in parameters}
    if scaled:  # a truth has as many modes as there are
        count = built.at_most(count)
    using.progress(f"{count} modes of {model.size} unknowns", 0.2)
    with blame(key):
        frequency, shape = lowest_modes(
            model.stiffness.at(theta), model.mass.at(theta), count, rigid=model.rigid, by=model.factorise
        )
    return Modes(frequency=frequency, shape=shape)


def _in_the_middle(config: PlacementConfig, mesh: Mesh) -> tuple[Parameter, ...]:
    """The free material properties at the geometric mean of their ranges."""
    middle_of = []
    for name, entry in config.parameters.items():
        if entry.property == DAMPING:
            continue
        regions, springs = ((), ()) if config.mesh.matrices is not None else places_of(name, entry, mesh, config.mesh)
        middle = float(np.sqrt(entry.range[0] * entry.range[1]))
        middle_of.append(Parameter(name, entry.property, regions, middle, springs, entry.range, entry.material))
    return tuple(middle_of)


def _require_strain(config: PlacementConfig, model: FiniteElementModel, S: np.ndarray) -> None:
    """Raises UserError for a load, columns of S (n_free, n_u), that a free structure follows as a whole."""
    reference = dict.fromkeys(model.mass.parameters, 1.0)  # of one density, which is a factor of the whole mass
    left = relief_of(model.mass.at(reference), np.asarray(model.rigid)).balanced(S)
    share = np.linalg.norm(left, axis=0) / np.linalg.norm(S, axis=0)
    for name, strained in zip(config.loads, share, strict=True):
        if strained < BALANCED:
            raise UserError(
                "the load pulls at all mass alike: it accelerates a free structure (mesh.free) as a whole and strains nothing "
                f"({strained:.1e} of it is left when the inertia is subtracted)",
                key=f"loads.{name}",
                remedy="remove the load, or hold the structure (mesh.supports) in place of mesh.free",
            )


def reduced_of(config: PlacementConfig, mesh: Mesh, modes: Modes, using: Resources) -> Reduced:
    """Assemble, constrain, find the static responses (and the modes off the reference), project, check at held-out values."""
    parameters = parameters_of(config.parameters, mesh, using.files, config.mesh)
    using.progress("assembly", 0.0)
    built = full_model(config.mesh, mesh, parameters, using.files, config.loads, solver_of(config, using))
    sweep = sweep_of(config, using)
    S = load_shapes(built.model, config.loads)
    if built.model.rigid is not None:
        _require_strain(config, built.model, S)
    off = misalignment_shapes(built.model, list(point_loads(config.loads).values()))
    reference = {p.name: p.reference for p in parameters}
    ranges = {name: config.parameters[name].range for name in reference}
    using.progress("static responses", 0.2)
    with blame("rom.modes"):
        reduction = reduce_model(
            built.model,
            S,
            tuple(config.loads),
            reference,
            ranges,
            config.rom.modes,
            config.rom.parameter_samples,
            config.rom.tolerance,
            damping_of(config.damping),
            (modes.frequency, built.in_coordinates(modes.shape)) if built.alike else None,
            watched(sweep, lambda share: using.progress("parameter samples", 0.2 + 0.5 * share)),
            off.reshape(len(off), -1),
            load_slopes(built.model, config.loads, parameters),
        )
    refuse_damping(reduction.model.damping, reduction.frequency)
    using.progress("held-out errors", 0.7)
    watch = watched(sweep, lambda share: using.progress("held-out errors", 0.7 + 0.3 * share))
    held_out = held_out_errors(built.model, S, reduction, held_out_samples(reference, ranges, HELD_OUT), watch)
    tried = np.array([[point[name] for name in reference] for point in held_out.theta])
    if config.train.model == "static":
        model, basis = quasi_static(reduction.model, reduction.basis)
        reduction = replace(reduction, model=model, basis=basis)
    free = damping_parameter(config.parameters, using.files)
    shape = np.tensordot(reduction.basis, off, axes=(0, 0))
    kept = np.linalg.solve(reduction.model.stiffness.at(reference), shape.reshape(len(shape), -1))
    missed = reduction.aside - reduction.basis @ kept
    return Reduced(
        model=reduction.model if free is None else reduction.model.with_damping(*free),
        frequency=reduction.frequency,
        basis=nodal(built.model, reduction.basis),
        static=reduction.static,
        misaligned=Misaligned(
            shape=shape,
            static=reduction.aside.reshape(off.shape),
            missed=nodal(built.model, missed).reshape(-1, *off.shape[1:]),
        ),
        error=ReductionErrors(
            parameters=tried.reshape(len(held_out.theta), -1), frequency=held_out.frequency, static=held_out.static
        ),
        results=None if built.modes is None else FromResults(modes=built.modes, notes=built.notes),
        matrices=None
        if built.motion is None
        else ReadyBasis(
            basis=built.motion @ reduction.basis,
            missed=(built.motion @ missed).reshape(-1, *off.shape[1:]),
            notes=tuple(built.notes),
        ),
    )


INERTIA_NOTED, INERTIA_MOST = 0.01, 0.1
"""Share of the reading that inertia would add: from the first on it is warned of, beyond the second refused."""
SAMPLES = 4
"""A period of the first mode, below which a record does not show how it swings."""


def inertia_problems(train: Train, training: Training, first: float) -> Iterator[str]:
    """What to say of the training: that inertia is left out and matters, or that it is there and cannot be seen.

    first: frequency of the first mode [Hz]. Raises InfeasibleError where inertia would add more than a tenth.
    """
    if train.model == "static":
        share = left_out(training, first)
        words = (
            f"inertia, which train.model: static leaves out, adds up to {100 * share:.2g} % to what these loads strain (first "
            f"mode {first:.4g} Hz)"
        )
        if share > INERTIA_MOST:
            raise InfeasibleError(words, key="train.model", remedy="train.model: dynamic, or slower loads")
        if share > INERTIA_NOTED:
            yield f"{words[0].upper()}{words[1:]}: σ does not know of it."
    elif first * train.time_step * SAMPLES > 1:
        yield (
            f"A step of {train.time_step:g} s is {first * train.time_step:.2g} periods of the first mode, {first:.4g} Hz: "
            "readings do not show how the structure swings, and the filter allows for any swinging. If the loads are "
            "slow, train.model: static knows them better; if not, take shorter steps."
        )


def left_out(training: Training, first: float) -> float:
    """RMS of q̈ over that of ω₁² q, the largest of all runs [-]: what inertia adds to the first mode, more than to others.

    Accelerations are second differences of the coordinates, whose lengths count the energy of a motion.
    """
    shares = [0.0]
    for run in training.motions:
        q, h = run.coordinate, run.time[1] - run.time[0]
        if len(q) > 2 and np.any(q):
            shares.append(
                np.linalg.norm(np.diff(q, 2, axis=0)) / h**2 / np.linalg.norm(q[1:-1]) / (2 * np.pi * first) ** 2
            )
    return float(max(shares))
