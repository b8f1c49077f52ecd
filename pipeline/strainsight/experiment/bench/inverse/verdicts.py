"""What an estimate of a bench is good for: the verdict on every unknown, warnings, and whether σ is given."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.estimate import FromFile
from strainsight.estimation.decision import (
    BEYOND,
    BORNE_OUT,
    CONTRADICTED,
    DIVERGED,
    INCONSISTENT,
    LOST,
    OVERCONFIDENT,
    TOO_CAUTIOUS,
    UNTESTED,
    WEAK,
    WITHHELD,
    Claim,
    Decision,
    judged,
    out_of_range,
    without_sigma,
)
from strainsight.experiment.bench.inverse.comparison import in_theta, smoothed_name
from strainsight.experiment.bench.inverse.estimation import Estimated
from strainsight.experiment.bench.inverse.problem import asked
from strainsight.pages.text import number

Scalar = float | str
"""Of a summary."""

HARDLY = 0.5
"""σ of a load over its largest value above which it is weakly observable."""
MATCHES = 0.01
"""Mismatch of a sensor up to which one bench moves as the other."""
REMEDY = (
    "set bodies.*.moduli.*.value nearer to it, keep more modes (bodies.*.modes), or look for a load, unit, support or "
    "sensor that is not as stated"
)
"""Of a modulus that came out beyond its `reach`."""


@dataclass(frozen=True)
class Evidence:
    """What an estimate is judged by.

    free: parameters that are estimated; numbers: the summary's, `nis` of so many innovations among them; claims by unknown,
    where the truth is known; lost (runs,) steps, −1 for none; held: hold-out claims; beyond: parameters outside their ranges.
    """

    config: BenchConfig
    free: tuple[str, ...]
    numbers: Mapping[str, Scalar]
    claims: Mapping[str, Claim]
    innovations: int
    lost: np.ndarray
    held: Sequence[Claim]
    beyond: Mapping[str, str]

    @property
    def names(self) -> tuple[str, ...]:
        return (*asked(self.config).inputs, *self.free)

    @property
    def in_test(self) -> bool:
        return isinstance(asked(self.config).measured, FromFile)

    @property
    def size(self) -> str:
        """The verdict on the innovations; empty where there is none."""
        nis = self._number("nis")
        return judged(np.sqrt(nis), self.innovations).verdict if nis >= 0 else ""

    @property
    def against(self) -> tuple[str, ...]:
        """Unknowns of no known truth where sensors contradict the model, whatever else is wrong with them."""
        # errors of gauges are in σ, and not in what innovations are held against
        against = self.size == OVERCONFIDENT and asked(self.config).tolerances is None
        against |= any(claim.overconfident for claim in self.held)
        return tuple(name for name in self.names if against and name not in self.claims)

    @property
    def decision(self) -> Decision:
        """Of a test, whether it is consistent with the model; of any run, whether parameters left their ranges."""
        estimate, words = asked(self.config), ""
        if self.in_test and self.against:
            more = "" if estimate.hold_out is not None else ", estimate.hold_out: each says which channel it is"
            check = f"check channels, units and noise of estimate.measured{more}"
            words = f"{INCONSISTENT}: {self._contradicted}: {check}"
        return Decision(words, accept=estimate.accept, beyond=self.beyond, remedy=REMEDY)

    @property
    def _contradicted(self) -> str:
        return f"{', '.join(self.against)} {'is' if len(self.against) == 1 else 'are'} {CONTRADICTED}"

    def verdict(self, name: str) -> str:
        """What is wrong with the estimate of an unknown, the gravest alone; else how error and σ compare, of a known truth,
        or whether sensors that were left out bear it out."""
        claim = self.claims.get(name)
        applies = {
            DIVERGED: self._number("lost") > 0,
            BEYOND: name in self.beyond,
            WITHHELD: bool(self.beyond),
            LOST: self.numbers.get(f"identified.{name}") is False,
            OVERCONFIDENT: claim is not None and claim.overconfident,
            CONTRADICTED: name in self.against,
            WEAK: name in asked(self.config).inputs and self._share(name) > HARDLY,
        }
        sound = claim.verdict if claim is not None else BORNE_OUT if self.held else UNTESTED
        return next((word for word, holds in applies.items() if holds), sound)

    def overconfident(self) -> Iterator[str]:
        """A sentence for every claim that does not hold."""
        for name in self.names:
            smoothed = f"the smoothed estimate of {name}"
            for subject, key in ((name, name), (smoothed, smoothed_name(name))):
                claim = self.claims.get(key)
                if claim is not None and claim.overconfident:
                    yield f"{subject} is {claim.words(number)}"

    def warnings(self) -> Iterator[str]:
        """Where the claim of an estimate does not hold, and why."""
        estimate, diverged = asked(self.config), self.lost[self.lost >= 0]
        if len(diverged):
            yield f"{len(diverged)} of {len(self.lost)} runs diverged, the first after {diverged.min()} steps"
        yield from self.overconfident()
        for name in estimate.inputs:
            if (share := self._share(name)) > HARDLY:
                yield (
                    f"{name} is weakly observable: σ is {100 * share:.3g} % of the largest load; give other sensors, "
                    "or make a load known"
                )
        for name in self.free:
            if self.numbers.get(f"identified.{name}") is False:
                yield (
                    f"{name} is not identified: its starts end further apart than one draw may be off (3.2 σ), its σ has not "
                    "halved, or it is wrong beyond it"
                )
        # Slow loads make innovations smaller, down to (m − n)/m: a warning only for a truth that the filter's model could make.
        if self.size == OVERCONFIDENT or (estimate.truth.model == "walk" and self.size == TOO_CAUTIOUS):
            nis = self._number("nis")
            off, noises = ("larger", "small") if nis > 1 else ("smaller", "large")
            tolerances = "; what gauges are off (estimate.tolerances) is in σ, and not in this claim"
            yield (
                f"innovations are {np.sqrt(max(nis, 1 / nis)):.3g} times {off} than the filter claims: its model is not the "
                f"bench, or increments, disturbance or noise are too {noises}{tolerances * bool(estimate.tolerances)}"
            )
        for name in estimate.sensors if estimate.measured is not None else ():
            if (mismatch := self._number(f"mismatch.{name}")) > MATCHES:
                where = "in the test" if self.in_test else f"on {getattr(estimate.measured, 'run', '')}"
                yield f"these loads do not make {name} read as {where}: it is {100 * mismatch:.3g} % off"

    def message(self, units: Mapping[str, str], decision: Decision) -> str:
        """One line: what does not hold, then what is known of every unknown, of a load relative to its largest true value, with σ
        as far as `decision` gives it; units of the unknowns."""
        estimates, estimate = [], asked(self.config)
        with_sigma, number_of = not decision.withheld, self._number
        for name in self.names:
            if f"error.{name}" in self.numbers:
                error, std = (100 * number_of(f"{key}.{name}") for key in ("error", "std"))
                estimates.append(f"{name} to {error:.2g} %" + f" (σ {std:.2g} %)" * with_sigma)
            elif f"ratio_slope.{name}" in self.numbers:
                slope, offset = (number_of(f"ratio_{key}.{name}") for key in ("slope", "offset"))
                estimates.append(f"{name} = {slope:.3g} of the one there {'+-'[offset < 0]} {abs(offset):.3g}")
            elif f"rms_std.{name}" in self.numbers or not with_sigma:
                kind, value = ("RMS ", "rms") if name in estimate.inputs else ("", "estimate")
                sigma = f" ± {number_of(f'rms_std.{name}'):.2g}" * with_sigma
                estimates.append(f"{name} {kind}{number_of(f'{value}.{name}'):.4g}{sigma} {units[name]}")
        if estimate.measured is not None:
            worst = max((number_of(f"mismatch.{name}") for name in estimate.sensors), default=np.nan)
            estimates.insert(0, f"sensors {100 * worst:.2g} % off")
        wrong = [*self.overconfident()]
        wrong += [f"{name} is not identified" for name in self.free if self.numbers.get(f"identified.{name}") is False]
        wrong += [self._contradicted] * bool(self.against and decision.trusted)
        if "hold_out.inside" in self.numbers:
            estimates.append(f"sensors by the others: {100 * number_of('hold_out.inside'):.3g} % within 2σ")
        parts = [*filter(None, (decision.message,)), *wrong, ", ".join(estimates) or "nothing comparable"]
        return f"{'; '.join(parts)}; {self.numbers['method']}, {self.numbers['truth']}"

    def _share(self, name: str) -> float:
        """σ of a load over its largest value; NaN of a load that is nothing."""
        if f"std.{name}" in self.numbers:
            return self._number(f"std.{name}")
        largest = self._number(f"largest.{name}")
        return self._number(f"rms_std.{name}") / largest if largest else np.nan

    def _number(self, key: str) -> float:
        return float(self.numbers.get(key, np.nan))


def claim_numbers(claims: Mapping[str, Claim]) -> dict[str, Scalar]:
    """Every claim by the names of a summary: verdict, ratio, draws and the largest ratio where σ holds."""
    numbers: dict[str, Scalar] = {}
    for name, own in claims.items():
        numbers |= {f"claim.{name}": own.verdict, f"claim_ratio.{name}": own.ratio}
        numbers |= {f"claim_draws.{name}": float(own.draws), f"claim_most.{name}": own.band[1]}
    return numbers


def bench_out_of_range(own: Estimated) -> dict[str, str]:
    """Modulus → that it came out beyond its `reach`, for those that did; of all runs, the first that did.

    Laws of bearings are exact at every diameter, radius and preload that their own checks let pass.
    """
    problem = own.problem
    ranges = {name: ends for body in problem.bench.reduced.values() for name, ends in body.reach.items()}
    beyond: dict[str, str] = {}
    for name in problem.unknowns.free:
        inner = problem.unknowns.parameters[name]
        for value in in_theta(own, own.place(name))[0][-1] if inner in ranges else ():
            if np.isfinite(value) and name not in beyond:
                low, high = map(float, ranges[inner])
                beyond |= out_of_range({name: float(value)}, {name: (low, high)}, {name: "Pa"}, "reduce")
    return beyond


def estimated_without_sigma(own: Estimated) -> Estimated:
    """The estimate with every σ withheld: NaN."""
    joint = np.full_like(own.filtered.joint, np.nan)
    filtered = replace(without_sigma(own.filtered), joint=joint, compared=None)
    return replace(own, filtered=filtered, without=without_sigma(own.without), rings=without_sigma(own.rings))
