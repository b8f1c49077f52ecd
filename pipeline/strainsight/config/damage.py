"""Fatigue damage of a test: S-N curve, mean stress correction, and settings of the uncertainty interval."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import Cycles, Plausible, Positive, Problem, Section, Stress, expert


class SNCurve(Section):
    """S-N curve N = cycles · (stress/Δσ)^slope: straight lines of ln N over ln Δσ."""

    slope: Annotated[float, Field(ge=1, le=30)] = Field(
        description="Slope m of the S-N curve for fewer cycles than `knee` [-]; the curve passes through the point (`cycles`, "
        "`stress`)."
    )
    stress: Stress = Field(
        description="Stress range or amplitude (see `of`) with a fatigue life of `cycles` cycles [Pa]."
    )
    of: Literal["range", "amplitude"] = expert(
        "range",
        description="Quantity that `stress` states: the stress range Δσ from valley to peak, or the stress amplitude σ_a = Δσ/2.",
    )
    cycles: Cycles = Field(2e6, description="Number of cycles to failure at `stress` [-].")
    knee: Cycles | None = Field(
        None, description="Number of cycles at the knee point of the S-N curve [-]; null: no knee point."
    )
    second_slope: Annotated[float, Field(ge=1, le=60)] | None = Field(
        None,
        description="Slope m₂ of the S-N curve for more cycles than `knee` [-]; null: stress ranges below the knee point "
        "cause no damage.",
    )
    cut_off: Cycles | None = Field(
        None,
        description="Number of cycles at the cut-off limit of the S-N curve [-]; stress ranges below the cut-off limit "
        "cause no damage. Null: no cut-off limit.",
    )


class MeanStressSection(Section):
    """Mean stress correction: every stress range is replaced by the range with the same damage at zero mean stress. The S-N curve
    has to be valid for zero mean stress (stress ratio R = −1)."""

    rule: Literal["none", "goodman", "fkm"] = expert(
        "none",
        description="Rule of the mean stress correction. With `none`: no correction. With `goodman`: Δσ/(1 − σ_m/R_m) for a "
        "tensile mean stress σ_m. With `fkm`: FKM guideline with the mean stress sensitivity M.",
    )
    tensile_strength: Stress | None = expert(None, description="Tensile strength R_m for `rule: goodman` [Pa].")
    sensitivity: Annotated[float, Field(ge=0, le=1)] | None = expert(
        None, description="Mean stress sensitivity M for `rule: fkm` [-]."
    )


class DamageSettings(Section):
    """Fatigue damage of the record at every surface point and every virtual gauge, with its uncertainty interval."""

    curve: SNCurve = Field(description="The S-N curve of the material.")
    mean_stress: MeanStressSection = expert(default_factory=MeanStressSection, description="Mean stress correction.")
    stress: Literal["signed_von_mises", "principal"] = expert(
        "signed_von_mises",
        description="Stress for the damage at the surface. With `signed_von_mises`: von Mises stress with the sign of the "
        "principal stress of largest magnitude. With `principal`: the principal stress of largest magnitude. For a virtual "
        "gauge, the stress is always E ε along the gauge.",
    )
    draws: Annotated[int, Field(ge=40, le=10_000)] = Field(
        200,
        description="Number of stress histories sampled from the posterior of the smoother, for the uncertainty interval of "
        "the damage [-].",
    )
    points: Annotated[Annotated[int, Field(ge=1)] | None, Plausible(1, 1e6)] = Field(
        None,
        description="Number of surface points with an uncertainty interval of the damage [-]: the points with the largest "
        "damage. Null: all points.",
    )
    equivalent_cycles: Cycles = expert(
        1e6, description="Reference number of cycles N_eq of the damage-equivalent stress range [-]."
    )
    repetitions: Annotated[Positive, Plausible(1e-6, 1e12)] = Field(
        1.0, description="Number of repetitions of the record [-]; the damage is the sum over all repetitions."
    )
    hot_spots: Annotated[int, Field(ge=1, le=1000)] = expert(
        10, description="Number of hot spots (surface points with the largest damage) in the printed table [-]."
    )

    def problems(self) -> Iterator[Problem]:
        curve, mean = self.curve, self.mean_stress
        if curve.second_slope is not None and curve.knee is None:
            remedy = "set estimate.damage.curve.knee, or remove `second_slope`"
            yield Problem("curve.second_slope", "the S-N curve has no knee point", remedy, at_key=True)
        if curve.cut_off is not None and curve.knee is not None and curve.cut_off <= curve.knee:
            what = f"a cut-off at {curve.cut_off:g} cycles is not beyond the knee point at {curve.knee:g} cycles"
            yield Problem("curve.cut_off", what, "increase `cut_off`, or remove `cut_off`")
        if curve.cut_off is not None and curve.knee is not None and curve.second_slope is None:
            what = "has no effect: without second_slope, stress ranges below the knee point cause no damage"
            yield Problem("curve.cut_off", what, "set `second_slope`, or remove `cut_off`", at_key=True)
        for rule, name in (("goodman", "tensile_strength"), ("fkm", "sensitivity")):
            is_set = getattr(mean, name) is not None
            if mean.rule == rule and not is_set:
                yield Problem("mean_stress", f"the rule {rule} needs {name}", f"set estimate.damage.mean_stress.{name}")
            if mean.rule != rule and is_set:
                remedy = f"remove `{name}`, or set estimate.damage.mean_stress.rule: {rule}"
                yield Problem(f"mean_stress.{name}", f"has no effect with the rule {mean.rule}", remedy, at_key=True)
