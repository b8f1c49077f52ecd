"""modes.h5, spectrum.h5 and rom.h5: modes, and the reduced-order model (5.1-5.10)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Self

import numpy as np

from strainsight.fem.affine import NO_CHANGE, AffineOperator, Coefficient, Newton
from strainsight.records.record import dataset, group, record, record_from
from strainsight.rom.model import Damping, ReducedModel, damping_derivative, damping_matrix


@record
class Modes:
    """modes.h5: at the reference. spectrum.h5: at the centre of the parameter ranges, without shapes if these depend on
    parameters."""

    frequency: np.ndarray = dataset("Hz", "/frequency", "natural frequencies")
    shape: np.ndarray = dataset(
        "kg^-1/2", "free degree of freedom × /frequency", "mass-normalised mode shapes on the free degrees of freedom"
    )


@record
class ChangeTerms:
    """`AffineOperator` without a constant term, with coefficients for all terms."""

    terms: dict[str, np.ndarray] = dataset(
        "<unit>", "channel × coordinate", "<what>: matrix of coefficient <name>", path="/<name>"
    )
    factors: dict[str, tuple[str, ...]] = dataset(
        "1",
        "root of <name>",
        "<what>: parameters of the coefficient Σ w Π (x − root)/scale, for a term <name> that is not a parameter",
    )
    roots: dict[str, np.ndarray] = dataset(
        "SI",
        "root of <name> × 6",
        "<what>: root, scale, lowest and highest value; saturation distance beyond these limits, as a fraction of the "
        "value (0: none); 1 for x = ln θ, otherwise x = θ",
    )
    weights: dict[str, np.ndarray] = dataset(
        "1",
        "product of <name>",
        "<what>: weight w of each product Π (x − root)/scale over the first roots of every parameter",
    )

    @classmethod
    def of(cls, operator: AffineOperator, **others: Any) -> Self:
        bases = {
            label: [(each, root) for each in coefficient.bases for root in each.roots]
            for label, coefficient in operator.coefficients.items()
        }
        return cls(
            terms=dict(operator.terms),
            factors={label: tuple(each.parameter for each, _ in roots) for label, roots in bases.items()},
            roots={
                label: np.array([[root, each.scale, *each.within, each.beyond, each.logarithm] for each, root in roots])
                for label, roots in bases.items()
            },
            weights={label: coefficient.weights.ravel() for label, coefficient in operator.coefficients.items()},
            **others,
        )

    def restore(self) -> AffineOperator:
        coefficients = {
            label: _coefficient(names, self.roots[label], self.weights[label]) for label, names in self.factors.items()
        }
        return replace(NO_CHANGE, terms=self.terms, coefficients=coefficients)


@record
class AffineTerms(ChangeTerms):
    """`AffineOperator` with dense matrices."""

    constant: np.ndarray = dataset("<unit>", "coordinate × coordinate", "<what>: constant term")
    terms: dict[str, np.ndarray] = dataset(
        "<unit> per SI unit",
        "coordinate × coordinate",
        "<what>: derivative with respect to <name>, or matrix of the coefficient <name>",
        path="/<name>",
    )

    @classmethod
    def of(cls, operator: AffineOperator, **others: Any) -> Self:
        return super().of(operator, constant=operator.constant, **others)

    def restore(self) -> AffineOperator:
        return replace(super().restore(), constant=self.constant)


def _coefficient(parameters: tuple[str, ...], roots: np.ndarray, weights: np.ndarray) -> Coefficient:
    """Roots (k, 6) of these parameters (k,)."""
    bases = []
    for name in dict.fromkeys(parameters):
        rows = roots[np.array(parameters) == name]
        _, scale, low, high, margin, logarithm = rows[0].tolist()
        bases.append(Newton(name, tuple(rows[:, 0].tolist()), scale, (low, high), margin, bool(logarithm)))
    return Coefficient(tuple(bases), weights.reshape([len(rows.roots) + 1 for rows in bases]))


@record
class ModelTerms:
    """`ReducedModel` (5.3), with the damping matrix at the reference."""

    mass: AffineOperator = group(AffineTerms, "1", "reduced mass matrix")
    stiffness: AffineOperator = group(AffineTerms, "1/s^2", "reduced stiffness matrix")
    damping: AffineOperator = group(AffineTerms, "1/s", "reduced damping matrix at the reference parameter values")
    law: Damping = group()
    input_shape: np.ndarray = dataset(
        "kg^-1/2",
        "coordinate × /inputs",
        "input matrix S at the reference parameter values: modal force per unit of each load",
    )
    input_slope: dict[str, np.ndarray] = dataset(
        "SI", "coordinate × /inputs", "derivative ∂S/∂<name> of the input matrix S, for a density with a body force"
    )
    inputs: tuple[str, ...] = dataset("1", "/inputs", "names of the loads")
    parameters: tuple[str, ...] = dataset("1", "/parameters", "names of the parameters")
    reference: np.ndarray = dataset(
        "SI",
        "/parameters",
        "reference values of the parameters; at these values, the reduced coordinates are modal coordinates",
    )

    @classmethod
    def of(cls, model: ReducedModel) -> ModelTerms:
        slopes = {name: damping_derivative(model, model.reference, name) for name in model.parameters}
        damping = AffineOperator(damping_matrix(model, model.reference), slopes)
        reference = np.array(list(model.reference.values()), dtype=float)
        return record_from(cls, model, damping=damping, law=model.damping, reference=reference)

    def restore(self) -> ReducedModel:
        return ReducedModel(
            mass=self.mass,
            stiffness=self.stiffness,
            input_shape=self.input_shape,
            inputs=self.inputs,
            reference=dict(zip(self.parameters, self.reference.tolist(), strict=True)),
            damping=self.law,
            input_slope=self.input_slope,
        )


@record
class ReductionErrors:
    """Parameter values that the basis was not built from, with the errors there."""

    parameters: np.ndarray = dataset(
        "SI",
        "point × parameter",
        "parameter values at which the reduced model is checked; they are not used for the reduction basis",
    )
    frequency: np.ndarray = dataset(
        "1",
        "point × mode",
        "relative error of the natural frequencies of the reduced model at every point of `parameters`",
    )
    static: np.ndarray = dataset(
        "1",
        "point × input",
        "relative error (energy norm) of the static responses of the reduced model at every point of `parameters`",
    )


@record
class ReadyBasis:
    """Data of a model with imported matrices."""

    basis: np.ndarray = dataset(
        "kg^-1/2", "row × coordinate", "reduction basis Ψ; row: degree of freedom of the imported matrices"
    )
    missed: np.ndarray = dataset(
        "m/N/rad or m/N/m",
        "row × input × misalignment",
        "part that the reduction basis Ψ cannot represent: change of the static displacement under a unit load, per unit "
        "misalignment of this load (two rotations, two shifts). Row: degree of freedom of the imported matrices",
    )
    notes: tuple[str, ...] = dataset("1", "note", "assumptions made in reading the matrices")


@record
class FromResults:
    """Data of a model from imported modes and static responses; its free unknowns are the modes and static residuals."""

    modes: int = dataset("1", "", "number of modes in the imported results")
    notes: tuple[str, ...] = dataset("1", "note", "messages of the checks of the imported modes and static responses")


@record
class Misaligned:
    """Effect of one misalignment of each load, two rotations [rad] and two shifts [m], on its input shape."""

    shape: np.ndarray = dataset(
        "kg^-1/2/rad or kg^-1/2/m",
        "coordinate × input × misalignment",
        "change of the input matrix S per unit misalignment of each load (two rotations, two shifts)",
    )
    static: np.ndarray = dataset(
        "m/N/rad or m/N/m",
        "free degree of freedom × input × misalignment",
        "change of the static displacement under a unit load, per unit misalignment of this load (two rotations, two shifts)",
    )
    missed: np.ndarray = dataset(
        "m/N/rad or m/N/m",
        "3 nodes × input × misalignment",
        "part that the reduction basis Ψ cannot represent: change of the static displacement of the nodes under a unit load, "
        "per unit misalignment of this load (two rotations, two shifts)",
    )


@record
class Reduced:
    """rom.h5."""

    model: ReducedModel = group(ModelTerms, path="/reduced")
    frequency: np.ndarray = dataset(
        "Hz", "/frequency", "natural frequencies of the full model at reference parameter values"
    )
    basis: np.ndarray = dataset(
        "kg^-1/2",
        "3 nodes × coordinate",
        "reduction basis Ψ: displacement of the nodes in global axes, per unit of each reduced coordinate; row = 3 × node "
        "index + component (x: 0, y: 1, z: 2)",
    )
    static: np.ndarray = dataset(
        "m/N",
        "free degree of freedom × input",
        "static displacement of the free degrees of freedom under a unit load of each input",
    )
    misaligned: Misaligned = group()
    error: ReductionErrors = group()
    matrices: ReadyBasis | None = group(default=None)
    results: FromResults | None = group(default=None)
