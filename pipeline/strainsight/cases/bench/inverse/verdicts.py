"""Warnings about an estimate: where its claim does not hold, and why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from strainsight.cases.bench.inverse.numbers import smoothed_name
from strainsight.cases.bench.inverse.unknowns import asked
from strainsight.cases.hold_out import Left
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.estimate import FromFile
from strainsight.estimation.verdict import DIVERGED, OVERCONFIDENT, TOO_CAUTIOUS, Claim, judged
from strainsight.report.placement.verdicts import (
    BEYOND,
    BORNE_OUT,
    CONTRADICTED,
    LOST,
    UNTESTED,
    WEAK,
    WITHHELD,
    in_words,
)

Scalar = float | str
"""Of a summary."""

HARDLY = 0.5
"""σ of a load over its largest value above which it is weakly observable."""
MATCHES = 0.01
"""Mismatch of a sensor up to which one bench moves as the other."""


def warnings_of(
    config: BenchConfig,
    free: tuple[str, ...],
    numbers: Mapping[str, Scalar],
    claims: Mapping[str, Claim],
    nis: float,
    innovations: int,
    lost: np.ndarray,
) -> Iterator[str]:
    """Sentences; numbers: the summary's, claims by unknown, nis: mean of so many innovations squared over their variance,
    lost (runs,) steps, −1 for none."""
    estimate, gone = asked(config), lost[lost >= 0]
    if len(gone):
        yield f"{len(gone)} of {len(lost)} runs diverged, the first after {gone.min()} steps"
    for name in (*estimate.inputs, *free):
        std = _float(numbers, f"std.{name}")
        for said, claim in ((name, claims.get(name)), (f"{name}, smoothed,", claims.get(smoothed_name(name)))):
            if claim is None or claim.verdict != OVERCONFIDENT:
                continue
            yield f"{said} is {in_words(claim)}"
        if name in estimate.inputs and std > HARDLY:
            yield (
                f"{name} is weakly observable: σ is {100 * std:.3g} % of the largest load; give other sensors, "
                "or make a load known"
            )
    yield from (
        f"{name} is not identified: its starts end further apart than one draw may be off (3.2 σ), its σ has not halved, or it "
        "is wrong beyond it"
        for name in free
        if numbers.get(f"identified.{name}") is False
    )
    size = _size(nis, innovations)
    # Slow loads make innovations smaller, down to (m − n)/m: only of a truth that the filter's model could have made is that odd.
    if size == OVERCONFIDENT or (estimate.truth.model == "walk" and size == TOO_CAUTIOUS):
        off, noises = ("larger", "small") if nis > 1 else ("smaller", "large")
        yield (
            f"innovations are {np.sqrt(max(nis, 1 / nis)):.3g} times {off} than the filter claims: its model is not the bench, "
            f"or increments, disturbance or noise are too {noises}"
            + (
                "; what gauges are off (estimate.tolerances) is in σ, and not in this claim"
                if estimate.tolerances
                else ""
            )
        )
    if estimate.measured is not None:
        for name in estimate.sensors:
            mismatch = _float(numbers, f"mismatch.{name}")
            if mismatch > MATCHES:
                there = "in the test" if isinstance(estimate.measured, FromFile) else f"on {estimate.measured.run}"
                yield f"these loads do not make {name} read as {there}: it is {100 * mismatch:.3g} % off"


def _size(nis: float, innovations: int) -> str:
    """The verdict on so many innovations, mean of their squares over their variance `nis`; empty where there is none."""
    return judged(np.sqrt(nis), innovations).verdict if nis >= 0 else ""


def verdicts_of(
    config: BenchConfig,
    free: tuple[str, ...],
    numbers: Mapping[str, Scalar],
    claims: Mapping[str, Claim],
    nis: float,
    innovations: int,
    rows: Sequence[Left],
) -> dict[str, str]:
    """What the estimate of every unknown is good for, in a word or two; arguments as of `warnings_of`, rows: of the hold-out.

    Where the truth is known, by error over σ. Where it is not, sensors have to bear it out: it is contradicted where innovations
    are larger than the filter claims, or the others contradict a channel that was left out.
    """
    estimate, judged_rows = asked(config), [own.claim.verdict for own in rows if own.claim is not None]
    against = contradicted(config, free, claims, nis, innovations, rows)
    found = {}
    for name in (*estimate.inputs, *free):
        claim = claims.get(name)
        word = UNTESTED if claim is None and not judged_rows else BORNE_OUT if claim is None else claim.verdict
        if name in estimate.inputs and _share(numbers, name) > HARDLY:
            word = WEAK
        if name in against:
            word = CONTRADICTED
        if claim is not None and claim.verdict == OVERCONFIDENT:
            word = OVERCONFIDENT
        if numbers.get(f"identified.{name}") is False:
            word = LOST
        if (beyond := str(numbers.get("out_of_range", ""))) and name not in estimate.inputs:
            word = BEYOND if f"{name} came out at" in beyond else WITHHELD
        elif beyond:
            word = WITHHELD
        found[name] = DIVERGED if _float(numbers, "lost") > 0 else word
    return found


def contradicted(
    config: BenchConfig,
    free: tuple[str, ...],
    claims: Mapping[str, Claim],
    nis: float,
    innovations: int,
    rows: Sequence[Left],
) -> tuple[str, ...]:
    """Unknowns of no known truth where sensors contradict the model, whatever else is wrong with them; arguments as of
    `verdicts_of`."""
    # errors of gauges are in σ, and not in what innovations are held against
    against = _size(nis, innovations) == OVERCONFIDENT and asked(config).tolerances is None
    against |= any(own.claim is not None and own.claim.verdict == OVERCONFIDENT for own in rows)
    return tuple(name for name in (*asked(config).inputs, *free) if against and name not in claims)


def contradiction_in_words(config: BenchConfig, against: Sequence[str]) -> str:
    """That the record of a test contradicts the model of unknowns `against`, and what to do; empty where there is none, and
    where it is no test."""
    if not against or not isinstance(asked(config).measured, FromFile):
        return ""
    more = "" if asked(config).hold_out is not None else ", estimate.hold_out: each says which channel it is"
    return (
        f"the record contradicts the model: {', '.join(against)} {'is' if len(against) == 1 else 'are'} {CONTRADICTED}: check "
        f"channels, units and noise of estimate.measured{more}"
    )


def message_of(
    config: BenchConfig,
    free: tuple[str, ...],
    numbers: Mapping[str, Scalar],
    units: Mapping[str, str],
    method: str,
    truth: str,
) -> str:
    """One line: what does not hold, then what is known of every unknown, of a load relative to its largest true value.

    units: of every unknown."""
    said, estimate = [], asked(config)
    withheld = [str(numbers[key]) for key in ("out_of_range", "withheld") if key in numbers]
    for name in (*estimate.inputs, *free):
        if f"error.{name}" in numbers:
            error, std = (100 * _float(numbers, f"{key}.{name}") for key in ("error", "std"))
            said.append(f"{name} to {error:.2g} %" + (f" (σ {std:.2g} %)" if not withheld else ""))
        elif f"ratio_slope.{name}" in numbers:
            offset = _float(numbers, f"ratio_offset.{name}")
            said.append(
                f"{name} = {_float(numbers, f'ratio_slope.{name}'):.3g} of the one there {'+-'[offset < 0]} {abs(offset):.3g}"
            )
        elif f"rms_std.{name}" in numbers or withheld:
            kind, value = ("RMS ", "rms") if name in estimate.inputs else ("", "estimate")
            sigma = "" if withheld else f" ± {_float(numbers, f'rms_std.{name}'):.2g}"
            said.append(f"{name} {kind}{_float(numbers, f'{value}.{name}'):.4g}{sigma} {units[name]}")
    if estimate.measured is not None:
        worst = max((_float(numbers, f"mismatch.{name}") for name in estimate.sensors), default=np.nan)
        said.insert(0, f"sensors {100 * worst:.2g} % off")
    wrong = [
        f"{name} is {OVERCONFIDENT} (error {_float(numbers, f'claim_ratio.{name}'):.2g} times the claimed σ)"
        for name in (*estimate.inputs, *free)
        if numbers.get(f"claim.{name}") == OVERCONFIDENT
    ]
    wrong += [f"{name} is not identified" for name in free if numbers.get(f"identified.{name}") is False]
    against = [name for name in (*estimate.inputs, *free) if numbers.get(f"verdict.{name}") == CONTRADICTED]
    if "withheld" not in numbers:
        wrong += [f"{', '.join(against)} {'is' if len(against) == 1 else 'are'} {CONTRADICTED}"] if against else []
    if "hold_out.inside" in numbers:
        said.append(f"sensors by the others: {100 * _float(numbers, 'hold_out.inside'):.3g} % within 2σ")
    return f"{'; '.join([*withheld, *wrong, ', '.join(said) or 'nothing comparable'])}; {method}, {truth}"


def claim_numbers(claims: Mapping[str, Claim]) -> dict[str, Scalar]:
    """Every claim by the names of a summary: verdict, ratio, draws and the largest ratio where σ holds."""
    numbers: dict[str, Scalar] = {}
    for name, own in claims.items():
        numbers |= {f"claim.{name}": own.verdict, f"claim_ratio.{name}": own.ratio}
        numbers |= {f"claim_draws.{name}": float(own.draws), f"claim_most.{name}": own.band[1]}
    return numbers


def _share(numbers: Mapping[str, Scalar], name: str) -> float:
    """σ of a load over its largest value; NaN of a load that is nothing."""
    if f"std.{name}" in numbers:
        return _float(numbers, f"std.{name}")
    largest = _float(numbers, f"largest.{name}")
    return _float(numbers, f"rms_std.{name}") / largest if largest else np.nan


def _float(numbers: Mapping[str, Scalar], key: str) -> float:
    return float(numbers.get(key, np.nan))
