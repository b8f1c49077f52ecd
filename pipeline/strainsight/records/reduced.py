"""modes.h5, spectrum.h5 and rom.h5: modes, and the finite-element model reduced to a few coordinates (5.1-5.10)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Self

import numpy as np

from strainsight.fem.affine import NO_CHANGE, AffineOperator, Coefficient, Newton
from strainsight.records.record import dataset, group, record, record_from
from strainsight.rom.model import Damping, ReducedModel, damping_derivative, damping_matrix


@record
class Modes:
    """modes.h5: at the reference. spectrum.h5: in the middle of the ranges, empty where shapes change with the parameters."""

    frequency: np.ndarray = dataset("Hz", "/frequency", "natural frequencies")
    shape: np.ndarray = dataset("kg^-1/2", "free unknown × /frequency", "mass-normalised shapes on the free unknowns")


@record
class ChangeTerms:
    """`AffineOperator` without a constant term, all of whose terms have coefficients."""

    terms: dict[str, np.ndarray] = dataset(
        "<unit>", "channel × coordinate", "<what>: what <name>, a coefficient, multiplies", path="/<name>"
    )
    factors: dict[str, tuple[str, ...]] = dataset(
        "1",
        "root of <name>",
        "<what>: parameters of the coefficient Σ w Π (x − root)/scale of a term <name> that is no parameter itself",
    )
    roots: dict[str, np.ndarray] = dataset(
        "SI",
        "root of <name> × 6",
        "<what>: root and scale; lowest and highest value, and how far beyond, as a share of it, the coefficient "
        "levels off (0: nowhere); 1: x is ln θ and not θ",
    )
    weights: dict[str, np.ndarray] = dataset(
        "1", "product of <name>", "<what>: w of all products of the first roots of each parameter"
    )

    @classmethod
    def of(cls, operator: AffineOperator, **others: Any) -> Self:
        bases = {
            label: [(each, root) for each in coefficient.bases for root in each.roots]
            for label, coefficient in operator.coefficients.items()
        }
        return cls(
            terms=dict(operator.terms),
            factors={label: tuple(each.parameter for each, _ in found) for label, found in bases.items()},
            roots={
                label: np.array([[root, each.scale, *each.within, each.beyond, each.logarithm] for each, root in found])
                for label, found in bases.items()
            },
            weights={label: coefficient.weights.ravel() for label, coefficient in operator.coefficients.items()},
            **others,
        )

    def made(self) -> AffineOperator:
        coefficients = {
            label: _coefficient(names, self.roots[label], self.weights[label]) for label, names in self.factors.items()
        }
        return replace(NO_CHANGE, terms=self.terms, coefficients=coefficients)


@record
class AffineTerms(ChangeTerms):
    """`AffineOperator`, dense."""

    constant: np.ndarray = dataset("<unit>", "coordinate × coordinate", "<what>: constant term")
    terms: dict[str, np.ndarray] = dataset(
        "<unit> per SI unit",
        "coordinate × coordinate",
        "<what>: slope in <name>, or in its coefficient",
        path="/<name>",
    )

    @classmethod
    def of(cls, operator: AffineOperator, **others: Any) -> Self:
        return super().of(operator, constant=operator.constant, **others)

    def made(self) -> AffineOperator:
        return replace(super().made(), constant=self.constant)


def _coefficient(parameters: tuple[str, ...], roots: np.ndarray, weights: np.ndarray) -> Coefficient:
    """roots (k, 6) of these parameters (k,)."""
    bases = []
    for name in dict.fromkeys(parameters):
        own = roots[np.array(parameters) == name]
        _, scale, low, high, beyond, logarithm = own[0].tolist()
        bases.append(Newton(name, tuple(own[:, 0].tolist()), scale, (low, high), beyond, bool(logarithm)))
    return Coefficient(tuple(bases), weights.reshape([len(own.roots) + 1 for own in bases]))


@record
class ModelTerms:
    """`ReducedModel` (5.3); its damping matrix is the one at the reference."""

    mass: AffineOperator = group(AffineTerms, "1", "reduced mass")
    stiffness: AffineOperator = group(AffineTerms, "1/s^2", "reduced stiffness")
    damping: AffineOperator = group(AffineTerms, "1/s", "reduced damping at the reference")
    law: Damping = group()
    input_shape: np.ndarray = dataset("kg^-1/2", "coordinate × /inputs", "input shape S at the reference")
    input_slope: dict[str, np.ndarray] = dataset(
        "SI", "coordinate × /inputs", "∂S/∂<name> of a density, where a load acts on its mass"
    )
    inputs: tuple[str, ...] = dataset("1", "/inputs", "name of every input")
    parameters: tuple[str, ...] = dataset("1", "/parameters", "name of every parameter")
    reference: np.ndarray = dataset("SI", "/parameters", "parameter values at which the coordinates are modal")

    @classmethod
    def of(cls, model: ReducedModel) -> ModelTerms:
        slopes = {name: damping_derivative(model, model.reference, name) for name in model.parameters}
        damping = AffineOperator(damping_matrix(model, model.reference), slopes)
        reference = np.array(list(model.reference.values()), dtype=float)
        return record_from(cls, model, damping=damping, law=model.damping, reference=reference)

    def made(self) -> ReducedModel:
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
    """Parameter values that the basis was not built from, and the errors there."""

    parameters: np.ndarray = dataset("SI", "point × parameter", "parameter values that the basis was not built from")
    frequency: np.ndarray = dataset("1", "point × mode", "relative error of the frequencies there")
    static: np.ndarray = dataset("1", "point × input", "relative energy-norm error of the static responses there")


@record
class ReadyBasis:
    """Where stiffness and mass came as ready matrices."""

    basis: np.ndarray = dataset("kg^-1/2", "row × coordinate", "basis Ψ on the rows of the matrices")
    missed: np.ndarray = dataset(
        "m/N/rad or m/N/m", "row × input × misalignment", "static responses that Ψ misses, on those rows"
    )
    notes: tuple[str, ...] = dataset("1", "note", "how the matrices were read")


@record
class FromResults:
    """Where modes and static responses came from another program; free unknowns are then the modes and static residuals."""

    modes: int = dataset("1", "", "how many modes there are results of")
    notes: tuple[str, ...] = dataset("1", "note", "what was found in the results")


@record
class Misaligned:
    """What one of each load's misalignments, two turns [rad] and two shifts [m], adds to its input shape."""

    shape: np.ndarray = dataset(
        "kg^-1/2/rad or kg^-1/2/m", "coordinate × input × misalignment", "change of the input shape S"
    )
    static: np.ndarray = dataset(
        "m/N/rad or m/N/m", "free unknown × input × misalignment", "change of the static response"
    )
    missed: np.ndarray = dataset(
        "m/N/rad or m/N/m", "3 nodes × input × misalignment", "what of it Ψ misses, on the nodes"
    )


@record
class Reduced:
    """rom.h5."""

    model: ReducedModel = group(ModelTerms, path="/reduced")
    frequency: np.ndarray = dataset("Hz", "/frequency", "natural frequencies of the full model at the reference")
    basis: np.ndarray = dataset(
        "kg^-1/2", "3 nodes × coordinate", "reduction basis Ψ on the nodes (3 node + component)"
    )
    static: np.ndarray = dataset("m/N", "free unknown × input", "static response to each input on the free unknowns")
    misaligned: Misaligned = group()
    error: ReductionErrors = group()
    matrices: ReadyBasis | None = group(default=None)
    results: FromResults | None = group(default=None)
