"""Full finite-element model of a structure (assembled, from matrices or from results), its modes, and its reduction, affine in
the parameters (5.1-5.10)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from strainsight.config.imported import Matrices
from strainsight.config.loads import LoadSection
from strainsight.config.mesh import MeshFile
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
from strainsight.fem.factorisation import Factorise, factorise, factorise_and_keep, factorise_or_reuse, relief_of
from strainsight.fem.loads import misalignment_shapes
from strainsight.fem.model import FiniteElementModel, FullModel, build_model, nodal
from strainsight.fem.modes import modes as lowest_modes
from strainsight.foreign.imported_matrices import ImportedMatrices, Term, build_imported_model, convert_matrices
from strainsight.foreign.matrices.files import NOTED, read_matrix, read_numbering, symmetric
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


def full_model(
    config: MeshFile,
    mesh: Mesh,
    parameters: Sequence[Parameter],
    files: Mapping[str, Path],
    loads: Mapping[str, LoadSection] | None = None,
    by: Factorise = factorise,
) -> FullModel:
    """Assemble the model, or import it from `mesh.matrices` or `mesh.results`; constrained, and affine in the parameters.

    config: section `mesh`; loads: whose static responses are imported with results; by: factorisation of
    the stiffness. The mesh gets densities and sections of the parameter references."""
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
            full = build_imported_model(mesh, ready)
        full = replace(full, notes=(*notes, *full.notes))
    return replace(full, model=replace(full.model, factorise=by))


def _with_densities(model: FiniteElementModel, parameters: Sequence[Parameter]) -> FiniteElementModel:
    """Set densities and sections of the mesh to the references, for body forces."""
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
    """Raises UserError if a density is estimated that does not scale the whole mass, as rigid-body modes would change with it."""
    if len(model.mass.terms) > 1 or (model.mass.terms and abs(model.mass.constant).sum() > 0):
        name = model.mass.parameters[0]
        raise UserError(
            "the density of only a part of a free structure is estimated, so its rigid-body modes would change",
            key=f"parameters.{name}",
            remedy="Estimate one density of all regions and remove point masses, or support the structure by soft springs "
            "(mesh.supports).",
        )


def _read(matrices: Matrices, config: MeshFile, files: Mapping[str, Path]) -> tuple[ImportedMatrices, list[str]]:
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
                        f"the matrix has {X.shape[0]} rows and {X.shape[1]} columns, but {path.name} has {len(node_ids)} "
                        "degrees of freedom",
                        where=str(files[key]),
                        remedy="Use a matrix and a numbering file of the same model.",
                    )
                X, off = symmetric(X, files[key])
            if off > NOTED:
                notes.append(
                    f"{files[key].name} was made symmetric; its largest asymmetry was {off:.1e} times the largest entry"
                )
            terms[kind].append(Term(X, entry.parameter, 1.0 if entry.at is None else entry.at))
    with blame("mesh.matrices"):
        ready = convert_matrices(
            node_ids,
            components,
            terms["stiffness"],
            terms["mass"],
            length_factor(config.length_unit),
            mass_factor(config.mass_unit),
            str(path),
        )
    return ready, notes


def solver_of(config: PlacementConfig, using: Resources, direct: Factorise = factorise) -> Factorise:
    """Factorisation by PARDISO (`direct`), or by MUMPS over MPI."""
    return direct if config.solver == "direct" else OverMpi(using.notice)


def sweep_of(config: PlacementConfig, using: Resources) -> Sweep:
    """Sweep over samples with a factorisation each: in threads or on a cluster; serial with MPI, which uses all processes."""
    if config.solver != "direct":
        return serial
    return in_threads(_fitting) if threads() > 1 else using.sweep


def _fitting() -> int:
    """Number of parallel samples that fit in memory, each estimated by the peak memory of this process."""
    return min(threads(), max(1, int(available_memory() / (peak_memory() or 1))))


HELD_OUT = 3
"""Number of parameter values, not used for the basis, at which the reduced model is checked."""

NO_MODES = Modes(frequency=np.zeros(0), shape=np.zeros((0, 0)))
"""Empty spectrum, if mode shapes change with the parameters."""

BALANCED = 1e-9
"""Relative load left after inertia relief below which it is a rounding error."""


def modes_of(config: PlacementConfig, mesh: Mesh, using: Resources) -> Modes:
    """Modes K φ = ω² M φ of the full model at the guess."""
    parameters = parameters_of(config.parameters, mesh, using.files, config.mesh)
    # while a stiffness is interpolated, a kept factor would raise the peak of the memory
    by = solver_of(config, using, factorise if _interpolated(mesh, parameters) else factorise_and_keep)
    return _lowest(config, mesh, at_their_references(parameters), config.rom.modes, "rom.modes", using, by)


def spectrum_of(config: PlacementConfig, mesh: Mesh, using: Resources) -> Modes:
    """Modes K φ = ω² M φ at the middle of the parameter ranges, so that runs on one mesh share the result.

    Empty if shapes change with the parameters, as for two materials or plies; `validate` then solves at the true values."""
    count, parameters = config.validation.truth.modes, _in_the_middle(config, mesh)
    if _interpolated(mesh, parameters):
        return NO_MODES  # no assembly needed
    return _lowest(
        config, mesh, parameters, count, "validate.truth.modes", using, solver_of(config, using), scaled=True
    )


def _interpolated(mesh: Mesh, parameters: Sequence[Parameter]) -> bool:
    """Whether the stiffness is not proportional to a parameter."""
    return any(shapes(mesh, number, parameter.property) for parameter in parameters for number in parameter.regions)


def _lowest(
    config: PlacementConfig,
    mesh: Mesh,
    parameters: tuple[Parameter, ...],
    count: int,
    key: str,
    using: Resources,
    by: Factorise,
    scaled: bool = False,
) -> Modes:
    """Solve for the lowest modes; scaled: empty unless the parameters only scale the matrices."""
    using.progress("assembly", 0.0)
    built = full_model(config.mesh, mesh, parameters, using.files, by=by)
    model = built.model
    if scaled and not only_scales(model):
        return NO_MODES
    theta = {p.name: p.reference for p in parameters}
    if scaled:  # imported results may have fewer modes
        count = built.at_most(count)
    using.progress(f"{count} modes of the model with {model.size} degrees of freedom", 0.2)
    with blame(key):
        frequency, shape = lowest_modes(
            model.stiffness.at(theta), model.mass.at(theta), count, rigid=model.rigid, by=model.factorise
        )
    return Modes(frequency=frequency, shape=shape)


def _in_the_middle(config: PlacementConfig, mesh: Mesh) -> tuple[Parameter, ...]:
    """Material parameters at the geometric mean of their ranges."""
    middle_of = []
    for name, entry in config.parameters.items():
        if entry.property == DAMPING:
            continue
        regions, springs = ((), ()) if config.mesh.matrices is not None else places_of(name, entry, mesh, config.mesh)
        middle = float(np.sqrt(entry.range[0] * entry.range[1]))
        middle_of.append(Parameter(name, entry.property, regions, middle, springs, entry.range, entry.material))
    return tuple(middle_of)


def _require_strain(config: PlacementConfig, model: FiniteElementModel, S: np.ndarray) -> None:
    """Raises UserError for a load (column of S (n_free, n_u)) that causes only rigid-body motion of a free structure."""
    reference = dict.fromkeys(model.mass.parameters, 1.0)  # a density scales the whole mass
    left = relief_of(model.mass.at(reference), np.asarray(model.rigid)).balance(S)
    share = np.linalg.norm(left, axis=0) / np.linalg.norm(S, axis=0)
    for name, strained in zip(config.loads, share, strict=True):
        if strained < BALANCED:
            raise UserError(
                "the load causes only rigid-body acceleration of the free structure (mesh.free) and no strain "
                f"(a fraction of {strained:.1e} of the load remains after inertia relief)",
                key=f"loads.{name}",
                remedy="Remove the load, or add supports (mesh.supports) instead of mesh.free.",
            )


def reduced_of(config: PlacementConfig, mesh: Mesh, modes: Modes, using: Resources) -> Reduced:
    """Assemble, compute static responses and modes at the samples, project, and check at held-out parameter values."""
    parameters = parameters_of(config.parameters, mesh, using.files, config.mesh)
    using.progress("assembly", 0.0)
    by = solver_of(config, using, factorise_or_reuse)
    built = full_model(config.mesh, mesh, parameters, using.files, config.loads, by)
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
        model, basis = quasi_static(reduction.model, reduction.basis, config.train.time_step)
        reduction = replace(reduction, model=model, basis=basis)
    free = damping_parameter(config.parameters, using.files)
    shape = np.tensordot(reduction.basis, off, axes=(0, 0))
    projected = np.linalg.solve(reduction.model.stiffness.at(reference), shape.reshape(len(shape), -1))
    missed = reduction.aside - reduction.basis @ projected
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
"""Inertial share of a reading from which a static model is warned of, and refused."""
SAMPLES = 4
"""Fewest samples per period of the first mode that resolve its motion."""


def inertia_problems(train: Train, training: Training, first: float) -> Iterator[str]:
    """Warnings that neglected inertia matters, or that the time step does not resolve the dynamics.

    first: frequency of the first mode [Hz]. Raises InfeasibleError if inertia exceeds a tenth of the reading."""
    if train.model == "static":
        share = neglected_inertia(training, first)
        words = (
            f"inertia, neglected by train.model: static, changes the strain by up to {100 * share:.2g} % in the "
            f"training simulation of the stage `train` (first mode {first:.4g} Hz)"
        )
        if share > INERTIA_MOST:
            raise InfeasibleError(words, key="train.model", remedy="Set train.model: dynamic, or use slower loads.")
        if share > INERTIA_NOTED:
            yield f"{words[0].upper()}{words[1:]}; σ does not include this error."
    elif first * train.time_step * SAMPLES > 1:
        yield (
            f"The time step of {train.time_step:g} s is {first * train.time_step:.2g} periods of the first mode ({first:.4g} Hz) "
            "and does not resolve the vibration. For slow loads, train.model: static is more accurate. Otherwise reduce "
            "train.time_step."
        )


def neglected_inertia(training: Training, first: float) -> float:
    """Inertial share RMS q̈ / RMS ω₁² q, the largest of all runs [-], an upper bound for all modes; q̈ by second differences."""
    shares = [0.0]
    for run in training.motions:
        q, h = run.coordinate, run.time[1] - run.time[0]
        if len(q) > 2 and np.any(q):
            shares.append(
                np.linalg.norm(np.diff(q, 2, axis=0)) / h**2 / np.linalg.norm(q[1:-1]) / (2 * np.pi * first) ** 2
            )
    return float(max(shares))
