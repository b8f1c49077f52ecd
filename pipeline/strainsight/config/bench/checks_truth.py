"""A truth by another integrator beside the estimate that takes it."""

from __future__ import annotations

from collections.abc import Iterator

from strainsight.config.base import Problem
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.connections import Driven
from strainsight.config.bench.estimate import Estimate

OWN = ("step", "duration", "histories", "within")
"""Keys that no other truth has."""
FEW = 1e-6
"""Share of a step by which two clocks may differ."""


def truth_problems(config: BenchConfig, estimate: Estimate) -> Iterator[Problem]:
    """What keys of `estimate.truth` ask of each other, of the filter's step and of the joints."""
    truth, key = estimate.truth, "estimate.truth"
    if truth.model == "walk" and estimate.tolerances is not None and estimate.measured is None:
        what = "a truth of the filter's own model has exact gauges"
        yield Problem(
            "estimate.tolerances", what, "take truth.model: fine or other, or leave tolerances out", at_key=True
        )
    if truth.model != "other":
        for name in OWN:
            if name in truth.model_fields_set and getattr(truth, name) != type(truth).model_fields[name].default:
                what = f"a truth '{truth.model}' has none"
                yield Problem(f"{key}.{name}", what, "leave it out, or set estimate.truth.model: other", at_key=True)
        return
    if any(isinstance(joint, Driven) for joint in config.joints.values()):
        yield Problem(f"{key}.model", "a driven joint has no such truth", "take fine")
    h = estimate.time_step or config.simulate.time_step
    every = round(h / truth.step)
    if every < 1 or abs(every * truth.step - h) > FEW * truth.step:
        what = f"steps of {truth.step:g} s do not divide the filter's step of {h:g} s"
        yield Problem(f"{key}.step", what, "divide estimate.time_step by a whole number", at_key=True)
    duration = estimate.duration or config.simulate.duration
    if truth.duration is not None and truth.duration < duration * (1 - FEW):
        what = f"it ends after {truth.duration:g} s, the estimate after {duration:g} s"
        yield Problem(f"{key}.duration", what, f"make it {duration:g} or more, or leave it out", at_key=True)
    if 1 < truth.histories < estimate.runs:
        what = f"{truth.histories} for {estimate.runs} runs"
        yield Problem(f"{key}.histories", what, f"make it {estimate.runs}, or 1: the same one for all")
    if truth.histories > 1 and truth.within == 0:
        yield Problem(f"{key}.histories", "all of them are the same", "give within, in seconds of the load histories")
