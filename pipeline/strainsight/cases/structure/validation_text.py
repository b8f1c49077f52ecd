"""What a validation has found, for people: numbers by name, a table and one line."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.cases.filters_compared import disagreements_in_words, ratios
from strainsight.cases.structure.filtering import posterior_doubts, posterior_numbers
from strainsight.cases.structure.problem import judged_as_stated_in_words, rests_on_loads_in_words, scheme_in_words
from strainsight.cases.structure.validation import Validation
from strainsight.estimation.decision import Claim
from strainsight.report.text import number
from strainsight.workflow.output import Scalar, Table


def validation_numbers(found: Validation, model: str) -> dict[str, Scalar]:
    """Every number by its name, model: that of the truth in the config."""
    trial, scheme = found.trial, scheme_in_words(found.trial.problem, found.trial.h)
    stopped = f"{trial.stopped} of the layout stopped at an edge" if trial.stopped else ""
    consistency = found.validated.consistency
    numbers: dict[str, Scalar] = {
        "truth": model,
        "description": "; ".join(filter(None, (trial.truth.description, scheme, stopped))),
    }
    for name, own in found.accuracy.items():
        for key in ("estimate", "error", "std", "draws", "smoothed", "smoothed_std", "smoothed_draws", "scale"):
            numbers[f"{key}.{name}"] = getattr(own, key)
        if name in trial.problem.unknowns.inputs:
            numbers[f"zero.{name}"] = own.zero
        if own.settling_time is not None:
            numbers[f"settling_time.{name}"] = own.settling_time
        if own.benefit is not None:
            numbers[f"benefit.{name}"] = own.benefit.verdict
        if own.rank is not None:
            numbers |= {f"rank_{key}.{name}": value for key, value in vars(own.rank).items()}
    return (
        numbers
        | posterior_numbers(found.validated.posterior)
        | ratios(found.validated.compared)
        | {
            "nees": float(np.mean(consistency.nees)),
            "nis": float(np.mean(consistency.nis)),
            "whiteness": found.whiteness,
            "verdict": found.verdict,
            "lost_runs": found.diverged,
        }
    )


def validation_message(found: Validation, claims: Mapping[str, tuple[Claim, ...]], withheld: str) -> str:
    """One line, first what does not hold; claims: on every unknown, the one that decides first; withheld: that there is no σ, and
    why."""
    trial, problem = found.trial, found.trial.problem
    words = [*filter(None, (withheld, rests_on_loads_in_words(problem), judged_as_stated_in_words(problem)))]
    words += [
        f"{name} is {every[0].words(number)}" for name, every in claims.items() if every and every[0].overconfident
    ]
    words += posterior_doubts(found.validated.posterior, trial.units)
    words += [
        f"placement brings no benefit for {name} here: {own.benefit.as_well} of {own.benefit.sets} random layouts of the same "
        "size do as well"
        for name, own in found.accuracy.items()
        if own.benefit is not None and own.benefit.verdict == "none"
    ]
    for name, own in found.accuracy.items():
        if name in trial.problem.unknowns.parameters:
            value = f"{name} {own.estimate:.4g} {trial.units[name]} (truth {trial.truth.theta[name]:.4g})"
            claimed = "" if withheld else f" (claimed σ {100 * own.std:.2g} %)"
            words.append(f"{value}, error {100 * own.error:.2f} %{claimed}")
        else:
            over = f" of its amplitude, {own.scale:.4g} N," if own.zero else ""
            words.append(f"{name} error {100 * own.error:.1f} %{over} filtered, {100 * own.smoothed:.1f} % smoothed")
    words += disagreements_in_words(found.validated.compared)
    return "; ".join(words)


MEDIANS = ("random sets, screened: median", "all: median")


def validation_table(found: Validation, withheld: bool) -> Table:
    """Every unknown by the layout, and the median error of random sets; withheld: whether σ is."""
    trial, validated = found.trial, found.validated
    columns = ("unknown", "estimate", "truth", "error", "claimed σ", "smoothed", *MEDIANS)
    rows = []
    for name, own in found.accuracy.items():
        if name in trial.problem.unknowns.parameters:
            rms, truth = "", f"{trial.truth.theta[name]:.5g}"
        else:
            rms, truth = " RMS", f"{np.sqrt(np.mean(trial.history[name] ** 2)):.5g}"
        truth += f", in % of its amplitude, {own.scale:.4g}" if own.zero else ""
        medians = (
            f"{100 * np.nanmedian(sets.error[name]):.3f} %" if len(sets.error[name]) else "-"
            for sets in (validated.screened, validated.all)
        )
        errors = [f"{100 * value:.3f} %" for value in (own.error, own.std, own.smoothed)]
        errors[1] = "withheld" if withheld else errors[1]
        rows.append((name, f"{own.estimate:.5g} {trial.units[name]}{rms}", truth, *errors, *medians))
    return Table(f"estimates; truth: {trial.truth.description}", columns, tuple(rows))
