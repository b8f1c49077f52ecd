"""The whole finite-element model of a case: assembled from the solids of the mesh, from ready matrices, or from results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from strainsight.config.loads import Load
from strainsight.config.mesh import Matrices, MeshFile
from strainsight.config.placement import PlacementConfig
from strainsight.contrib.mpi.session import OverMpi
from strainsight.errors import DeckError, UserError, blame
from strainsight.experiment.resources import Resources
from strainsight.experiment.structure.results import model_of_results
from strainsight.fem.affine import Parameter
from strainsight.fem.factorisation import Factorise, factorise
from strainsight.fem.model import FiniteElementModel, FullModel, build_model
from strainsight.foreign.matrices.files import NOTED, read_matrix, read_numbering, symmetric
from strainsight.foreign.ready import ReadyMatrices, Term, build_ready_model, ready_matrices
from strainsight.memory import available_memory
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import OF_MASS, with_value
from strainsight.mesh.units import length_factor, mass_factor
from strainsight.parallel import Sweep, in_threads, serial, threads
from strainsight.processes import peak_memory

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
    loads: Mapping[str, Load] | None = None,
    by: Factorise = factorise,
) -> FullModel:
    """Assemble, or read matrices where `mesh.matrices` says so, or results where `mesh.results` does; constrained and affine in
    the parameters in any case. The mesh of an assembled model and of one from results has the densities and sections of the
    parameters' references.

    config: the section `mesh`, of which READS are read; loads: those whose static responses results are read for; by: who
    factorises its stiffness.
    """
    built = _built(config, mesh, parameters, files, loads)
    return replace(built, model=replace(built.model, factorise=by))


def _built(
    config: MeshFile,
    mesh: Mesh,
    parameters: Sequence[Parameter],
    files: Mapping[str, Path],
    loads: Mapping[str, Load] | None,
) -> FullModel:
    if config.results is not None:
        full = model_of_results(config, mesh, parameters, files, loads)
        return replace(full, model=_with_densities(full.model, parameters))
    if config.matrices is None:
        with blame("mesh.file"), mesh.located():
            model = _with_densities(build_model(mesh, parameters, free=config.free), parameters)
        if config.free:
            _whole_mass(model)
        return FullModel(model)
    ready, said = _read(config.matrices, config, files)
    with blame("mesh.matrices.numbering"), mesh.located():
        full = build_ready_model(mesh, ready)
    return replace(full, notes=(*said, *full.notes))


def _with_densities(model: FiniteElementModel, parameters: Sequence[Parameter]) -> FiniteElementModel:
    """Loads that act on mass are those of the mass at the reference."""
    for own in parameters:
        known = own.property != "density" or all(model.mesh.density_of(number) is not None for number in own.regions)
        if own.property in OF_MASS and known:
            model = replace(model, mesh=with_value(model.mesh, own.property, own.regions, own.reference))
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
    said: list[str] = []
    terms: dict[str, list[Term]] = {"stiffness": [], "mass": []}
    for kind, own in (("stiffness", matrices.stiffness), ("mass", matrices.mass)):
        for i, entry in enumerate(own):
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
                said.append(
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
    return ready, said


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
