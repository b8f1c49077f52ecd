"""Parameters of the model and damping."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from strainsight.config.base import (
    PROPERTY,
    Id,
    NotNegative,
    Plausible,
    Positive,
    Problem,
    Section,
    Text,
    expert,
)


class GuessFrom(Section):
    """Guess of a parameter, taken from the estimate of another run."""

    source: Text = Field(
        alias="from",
        description="Name of the run with the estimate (results/NAME/validate.h5), or path of a file validate.h5 or estimate.h5 "
        "relative to the folder of the config.",
    )
    stage: Literal["validate", "estimate"] = expert(
        "validate",
        description="Stage with the estimate: `validate` (simulated measurements), or `estimate` (measurements of a test, in "
        "results/NAME/estimate.h5).",
    )


Guess = Annotated[
    Annotated[Positive, Tag("number")] | Annotated[GuessFrom, Tag("from")],
    Discriminator(lambda value: "from" if isinstance(value, dict | GuessFrom) else "number"),
]


class MaterialParameter(Section):
    """A free parameter of the reduced model: a property of some regions, or a factor on the stiffness of springs."""

    property: Literal[
        "youngs_modulus",
        "density",
        "stiffness_factor",
        "e1",
        "e2",
        "g12",
        "g1z",
        "g2z",
        "area_factor",
        "bending_factor",
        "torsion_factor",
        "damping_factor",
        "thickness",
    ] = Field(
        description="Property that the parameter changes. Materials: youngs_modulus [Pa] and density [kg/m³]; in a laminate, "
        "the mean over the thickness. Regions of any kind, or `springs`: stiffness_factor [-], a factor on the whole "
        "stiffness. Plies of laminates [Pa]: moduli e1 along and e2 across the fibres, shear moduli g12, g1z, g2z, or "
        "youngs_modulus of isotropic plies. Beams, relative to the deck [-]: area_factor (area and mass), bending_factor "
        "(all second moments of area), torsion_factor (torsion constant). area_factor also applies to rods, bending_factor "
        "also to homogeneous shells. Damping: damping_factor [-], a factor on `damping` in every mode, without `region`. "
        "Shells: thickness [m], including the mass and the surfaces with gauges; all plies of a laminate are scaled by the "
        "same factor."
    )
    region: Id | Text | Annotated[tuple[Id | Text, ...], Field(min_length=1)] | None = Field(
        None,
        description="Id (such as the PSOLID id) or name of a region, or a list of ids and names. Omit `region` with `springs`, "
        "mesh.matrices or a damping_factor. With mesh.results, omit `region` for a parameter of all regions.",
    )
    springs: Annotated[tuple[Text, ...], Field(min_length=1)] | None = Field(
        None,
        description="Springs that a stiffness_factor scales, instead of `region`: names as listed by `strainsight import` "
        "(CELAS2 12, CBUSH 3, SPRINGA 7, mesh.supports.0 of the config), or patterns of names (CELAS2 *).",
    )
    material: Id | Text | None = Field(
        None,
        description="For a ply modulus: id or name of the ply material (MAT8, MAT1). Required if the regions have several ply "
        "materials of one kind.",
    )
    guess: Annotated[Guess, PROPERTY] = Field(
        description="Nominal value of the parameter before any measurement [Pa, kg/m³, m, or 1 for a factor], or {from: NAME} "
        "for the estimate of the run NAME."
    )
    range: Annotated[tuple[Positive, Positive], PROPERTY] = Field(
        description="Range [lowest, highest] of the parameter, for which the reduced model is built [Pa, kg/m³, m, or 1 for a "
        "factor]."
    )
    process_noise_scale: Annotated[Positive, Plausible(1e-6, 10.0, "1/√s")] = Field(
        0.05,
        description="Drift rate δ of the parameter, relative to the guess [1/√s; 1/s if process_noise.rule is `thesis` or "
        "`as_printed`]. The drift rate applies to the steady-state filter for placement, and to filters with `filter.drift: "
        "true`. In other filters, the parameter is constant.",
    )

    def problems(self) -> Iterator[Problem]:
        low, high = self.range
        if low >= high:
            what = f"the lower limit {low:g} is not below the upper limit {high:g}"
            yield Problem("range", what, "set `range: [lowest, highest]`")
        elif isinstance(self.guess, float) and not low <= self.guess <= high:
            what = f"the guess {self.guess:g} is outside the range {low:g} to {high:g}"
            yield Problem("guess", what, "extend `range`, or change `guess`")


class ModalDamping(Section):
    """Equal damping ratio in every mode."""

    type: Literal["modal"] = Field(description="Kind of damping: equal ratio in every mode.")
    ratio: Annotated[float, Plausible(1e-5, 0.2)] = Field(ge=0, lt=1, description="Damping ratio of every mode [-].")


class RayleighDamping(Section):
    """Rayleigh damping: C = αM + βK."""

    type: Literal["rayleigh"] = Field(description="Kind of damping: Rayleigh damping.")
    alpha: Annotated[NotNegative, Plausible(1e-6, 1e3, "1/s")] = expert(
        description="Coefficient α of the mass matrix [1/s]."
    )
    beta: Annotated[NotNegative, Plausible(1e-12, 0.1, "s")] = expert(
        description="Coefficient β of the stiffness matrix [s]."
    )


Damping = Annotated[ModalDamping | RayleighDamping, Field(discriminator="type")]
DAMPING_TEXT = "Damping of the structure: modal damping or Rayleigh damping."


class Damped(Section):
    """Damping of the structure."""

    damping: Damping = Field(description=DAMPING_TEXT)
