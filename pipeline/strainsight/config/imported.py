"""Matrices, modes and static responses of other programs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import (
    Id,
    Name,
    ParameterValue,
    Plausible,
    Section,
    Text,
    expert,
)


class MatrixTerm(Section):
    """One term of the stiffness or mass matrix, from a file: X(θ) = Σ X_i. A term that is proportional
    to a parameter θ contributes X_i θ/`at`."""

    file: Text = Field(
        description="Matrix file in the units of the deck: OP4 (.op4), Matrix Market (.mtx), NumPy/SciPy (.npz) or CalculiX "
        "(.sti, .mas)."
    )
    name: Text | None = Field(None, description="Name of the matrix, if the file contains several matrices.")
    parameter: Name | None = Field(
        None, description="Name of the parameter to which this term is proportional; null: the term is constant."
    )
    at: ParameterValue | None = Field(
        None,
        description="Value of `parameter` in the model that wrote the matrix [Pa, kg/m³ or 1]. Null: 1, for a matrix "
        "written at the parameter value 1.",
    )


class Matrices(Section):
    """Stiffness and mass matrices from another program, instead of matrices assembled by strainsight."""

    numbering: Text = Field(
        description="CSV file with one line for each matrix row: node id, component 1-6; the header is node,component. Or a "
        "CalculiX .dof file."
    )
    stiffness: Annotated[tuple[MatrixTerm, ...], Field(min_length=1)] = Field(
        description="One or more matrix files; the stiffness matrix is the sum of these terms."
    )
    mass: Annotated[tuple[MatrixTerm, ...], Field(min_length=1)] = Field(
        description="One or more matrix files; the mass matrix is the sum of these terms."
    )


Step = Annotated[Id, Field(ge=0)] | Text


class InResults(Section):
    """File and step of a result of another program."""

    file: Text | None = Field(None, description="Results file that contains this result; null: mesh.results.file.")
    step: Step | None = Field(
        None,
        description="Number or title of the step or subcase in the results file. For a static response: the step in which this "
        "load acts alone. Null: the only step with modes, or the only static step.",
    )


class ModesOfResults(InResults):
    """File and step of the natural frequencies and mode shapes."""


class ResponseOfLoad(InResults):
    """File and step of the static response to one load."""

    magnitude: Annotated[float, Plausible(1e-9, 1e12, "in the unit of the load")] = Field(
        1.0,
        description="Load magnitude in the step of this response, in the unit of the load [N, N m, Pa …]. Example: 500 for 500 "
        "N along the direction of the load, −500 for the opposite direction.",
    )


class ResultsFile(Section):
    """A results file of another program, and the step with its modes."""

    file: Text = Field(
        description="Results file of this mesh, in the units of the mesh: .frd (CalculiX), .op2 or .pch (Nastran), .unv or .uff "
        "(universal), .rst (Ansys), .vtu or .vtk. Modes and responses without `file` are read from this file."
    )
    modes: ModesOfResults = expert(
        default_factory=ModesOfResults, description="File and step with the natural frequencies and mode shapes."
    )


class SecondResults(ResultsFile):
    """Modes and static responses at another value of one parameter, to separate the stiffness or mass of the regions of this
    parameter from the rest."""

    parameter: Name = Field(
        description="Name of the parameter with another value in the second set of results. The parameter needs `region`, and "
        "the property youngs_modulus, stiffness_factor or density."
    )
    at: ParameterValue = Field(
        description="Parameter value of the second set of results [Pa, kg/m³ or 1]. The value of the first set is "
        "mesh.results.at; default: value of the mesh materials, or 1 for a stiffness_factor."
    )
    loads: dict[Name, ResponseOfLoad] | None = expert(
        None,
        description="Static responses of the second set of results, with the keys of mesh.results.loads. Null: steps and load "
        "magnitudes as in mesh.results.loads; the responses are read from mesh.results.second.file.",
    )


class ResultsSection(ResultsFile):
    """Modes and static responses from another program, instead of stiffness and mass matrices."""

    loads: dict[Name, ResponseOfLoad] = Field(
        {},
        description="Static response to each load alone, by load name (`loads`). The response contains the local deformation "
        "that the modes cannot represent. Without this response, the strain near the load is too small.",
    )
    modal_mass: Literal["auto", "unit", "mesh"] = expert(
        "auto",
        description="Modal masses ΦᵀMΦ of the mode shapes. With `unit`: 1 in the units of the mesh. With `mesh`: computed from "
        "the densities of the mesh. With `auto`: as stated in the results file; if the file states no modal masses, as with "
        "`mesh`.",
    )
    at: dict[Name, ParameterValue] = Field(
        {},
        description="Parameter values of the model that produced the results, by parameter name [Pa, kg/m³ or 1]. Default: "
        "values of the mesh materials, and 1 for a stiffness_factor.",
    )
    second: SecondResults | None = Field(
        None,
        description="A second set of results, from the same model with another value of the parameter in "
        "mesh.results.second.parameter. The second set is required for a parameter with `region`.",
    )
