"""Fatigue damage of a test: S-N curve, mean stress, which stress, how many draws."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import Cycles, Positive, Section, Stress, with_defaults
from strainsight.config.plausible import Plausible
from strainsight.config.problem import Problem


class SNCurve(Section):
    """N = cycles · (stress/Δσ)^slope: straight lines of ln N over ln Δσ."""

    slope: Annotated[float, Field(ge=1, le=30)] = Field(description="m of the line through `stress` [-].")
    stress: Stress = Field(description="Of which the material bears `cycles` cycles [Pa], a range or an amplitude.")
    of: Literal["range", "amplitude"] = Field(
        "range", description="What `stress` is: a range Δσ, from valley to peak, or an amplitude σ_a = Δσ/2."
    )
    cycles: Cycles = Field(2e6, description="At `stress` [-].")
    knee: Cycles | None = Field(
        None, description="Cycles at which the line ends [-]; null: it goes on to any number of them."
    )
    second_slope: Annotated[float, Field(ge=1, le=60)] | None = Field(
        None, description="m₂ beyond the knee [-]; null: ranges below that of the knee do no damage."
    )
    cut_off: Cycles | None = Field(
        None, description="Cycles on the curve whose range and all below do no damage [-]; null: none."
    )


class MeanStress(Section):
    """Which range about no mean does the same damage; the S-N curve is then one of mean zero (R = −1)."""

    rule: Literal["none", "goodman", "fkm"] = Field(
        "none",
        description="none: ranges as they are. goodman: Δσ/(1 − σ_m/R_m) under tension. fkm: by the mean stress sensitivity "
        "M, as the FKM guideline has it.",
    )
    tensile_strength: Stress | None = Field(None, description="R_m of goodman [Pa].")
    sensitivity: Annotated[float, Field(ge=0, le=1)] | None = Field(None, description="M of fkm [-].")


class DamageSettings(Section):
    """Damage of the record at every point of the surface and every virtual gauge, with its interval."""

    curve: SNCurve = Field(description="The S-N curve of the material.")
    mean_stress: MeanStress = with_defaults(MeanStress, "What a mean stress does.")
    stress: Literal["signed_von_mises", "principal"] = Field(
        "signed_von_mises",
        description="Of the surface: von Mises' stress with the sign of the principal stress of the largest size, or that "
        "principal stress. Of a virtual gauge it is E ε along the gauge.",
    )
    draws: Annotated[int, Field(ge=40, le=10_000)] = Field(
        200, description="Histories drawn from what the smoother leaves open [-]."
    )
    points: Annotated[Annotated[int, Field(ge=1)] | None, Plausible(1, 1e6)] = Field(
        None,
        description="Interval at so many points of the surface, those most damaged by the smoothed mean [-]; null: at all.",
    )
    equivalent_cycles: Cycles = Field(1e6, description="N_eq of the damage-equivalent range [-].")
    repetitions: Annotated[Positive, Plausible(1e-6, 1e12)] = Field(
        1.0, description="How often the record is repeated [-]; damage is that of all."
    )
    hot_spots: Annotated[int, Field(ge=1, le=1000)] = Field(10, description="Places listed [-].")


def damage_problems(own: DamageSettings, key: str) -> Iterator[Problem]:
    """Contradictions within the section."""
    curve, mean = own.curve, own.mean_stress
    if curve.second_slope is not None and curve.knee is None:
        yield Problem(f"{key}.curve.second_slope", "there is no knee", f"state {key}.curve.knee, or leave it out", True)
    if curve.cut_off is not None and curve.knee is not None and curve.cut_off <= curve.knee:
        yield Problem(
            f"{key}.curve.cut_off",
            f"{curve.cut_off:g} cycles are not beyond the knee, {curve.knee:g}",
            "state more, or leave it out",
        )
    if curve.cut_off is not None and curve.knee is not None and curve.second_slope is None:
        yield Problem(
            f"{key}.curve.cut_off", "nothing below the knee does damage", "state second_slope, or leave it out", True
        )
    for rule, name, value in (
        ("goodman", "tensile_strength", mean.tensile_strength),
        ("fkm", "sensitivity", mean.sensitivity),
    ):
        if mean.rule == rule and value is None:
            yield Problem(f"{key}.mean_stress", f"{rule} needs {name}", f"state {key}.mean_stress.{name}")
        if mean.rule != rule and value is not None:
            yield Problem(
                f"{key}.mean_stress.{name}", f"the rule is {mean.rule}", f"leave it out, or set rule: {rule}", True
            )
