"""Consistency of measurements with the model and with each other: set-up of the check, and its result in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.estimation.conditional import ConsideredParameters
from strainsight.estimation.decision import INCONSISTENT
from strainsight.estimation.fault_evidence import CheckRecord
from strainsight.estimation.faults import ANGLES, APART, MARGIN, Explained
from strainsight.estimation.model import FilterModel
from strainsight.estimation.peak import find_common_peak
from strainsight.estimation.record_check import RecordCheck, check_record
from strainsight.experiment.structure.considered import build_considered, on_average, tolerated
from strainsight.experiment.structure.fault_text import (
    CHECK_MODE,
    FaultInWords,
    inspection_in_words,
    pattern_in_words,
    shift_in_words,
    time_of,
)
from strainsight.experiment.structure.measured import Measured
from strainsight.experiment.structure.problem import Problem
from strainsight.experiment.structure.record_filter import RecordFilter
from strainsight.experiment.structure.structure import Structure
from strainsight.records.estimated import ChannelsChecked
from strainsight.records.record import record_from
from strainsight.rom.model import modal_basis
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.strain_operator import channel_rows, fits
from strainsight.sensors.surface import turned

OTHER_STEP = 100.0
"""Ratio of sampling interval and `train.time_step` that suggests a wrong unit of time."""


@dataclass(frozen=True)
class Turning:
    """Strain operators of gauges rotated on the surface by ANGLES; NaN where a channel cannot be rotated.

    rows (m, angles, n): per reduced coordinate; missed (m, angles, n_u, misalignments): of misaligned loads."""

    rows: np.ndarray
    missed: np.ndarray


def turning_of(structure: Structure, channels: np.ndarray) -> Turning:
    """Rotate channels (m,) of train.h5. Only strain gauges on the mesh whose rotated grid stays on the surface can be rotated;
    bridges cannot."""
    training, missed = structure.training, structure.reduced.misaligned.missed
    n = training.rows.shape[1]
    rows = np.full((len(channels), len(ANGLES), n), np.nan)
    more = np.zeros((*rows.shape[:2], *missed.shape[1:]))
    pool, position = structure.pool, structure.mesh.position
    single = np.flatnonzero(
        (pool.quantity == STRAIN)[channels] & ~pool.bridged[channels] & (training.strain_operator is None)
    )
    if len(single):
        for k, angle in enumerate(ANGLES):
            # every channel as a gauge of one grid
            part = replace(_turned(pool.take(channels[single]), angle), gauge=np.arange(len(single)))
            well = np.flatnonzero(fits(position, part, structure.skin.facets))
            lying = part.take(well)
            read = channel_rows(position, lying, structure.field, facets=structure.skin, thickness=structure.thickness)
            rows[single[well], k], more[single[well], k] = read[:, :n], read[:, n:].reshape(-1, *missed.shape[1:])
    return Turning(rows, more)


def _turned(pool: Candidates, angle: float | np.ndarray) -> Candidates:
    each = np.broadcast_to(np.asarray(angle, dtype=float), (len(pool),))
    return replace(pool, direction=turned(pool.direction, pool.normal, each))


def build_check_record(structure: Structure, record: RecordFilter, turning: Turning) -> CheckRecord:
    """Set up the fault search with the parameter grid filter, the only one that includes the tolerances."""
    model, test, channels, training = record.model, record.test, record.test.channels, structure.training
    Q, at = np.array(model.Q), model.parameter_states
    Q[..., at, :], Q[..., :, at] = 0.0, 0.0
    constant = replace(model, Q=Q)
    wide = np.full((*turning.rows.shape[:2], model.size), 0.0)
    wide[..., : turning.rows.shape[-1]] = turning.rows
    moving, motion = np.array(record.covariance), model.motion
    moving[motion, motion] = np.diag(np.abs(record.problem.x).max(axis=0) ** 2)

    def with_turned(j: int, angle: float) -> tuple[FilterModel, ConsideredParameters]:
        k, channel = ANGLES.index(angle), channels[j]
        H = np.array(constant.H)
        H[j] = wide[j, k]
        # rows of the guess: how they change with a thickness is known of the channel as it was meant
        change = constant.change.of_terms(lambda X: np.where((np.arange(len(X)) == j)[:, None], 0.0, X))
        one = np.zeros(len(training.candidates))
        one[channel] = angle
        rows, missed = np.array(training.rows), np.array(training.missed)
        rows[channel], missed[channel] = turning.rows[j, k], turning.missed[j, k]
        as_turned = replace(training, candidates=_turned(training.candidates, one), rows=rows, missed=missed)
        tolerances = tolerated(replace(structure, training=as_turned), channels)
        # the others have what they read on average over their installations already
        H[j] = on_average(tolerances, replace(constant, H=H), channels).H[j]
        changed = replace(constant, H=H, change=change)
        return changed, build_considered(tolerances, changed, channels)

    return CheckRecord(
        model=constant,
        mean=np.zeros(len(record.covariance)),
        covariance=record.covariance,
        known=test.known,
        samples=test.values,
        considered=build_considered(record.tolerances, constant, channels),
        biased=record.biased,
        settled=record.settled,
        turned_rows=wide,
        turned=with_turned,
        load=np.tile(np.arange(len(record.problem.known)), 2)[: test.known.shape[-1]],
        moving=moving,
    )


@dataclass(frozen=True)
class ConsistencyResult:
    """Result of the consistency check of one record.

    words: why the record is inconsistent with the model, else empty; named: the only fault that explains it, with the key that
    corrects it, else empty; check: by channel; disagrees: the record is inconsistent with other records, not with the model;
    birge_ratio: RMS of the innovations over the predicted value, 1 for a consistent record and where no filter runs."""

    words: str
    named: str
    check: ChannelsChecked
    disagrees: bool = False
    birge_ratio: float = 1.0

    @property
    def trusted(self) -> bool:
        return not self.words


def check_consistency(
    test: Measured, problem: Problem, checked_record: CheckRecord, discrepancy: float, progress: Callable[[float], None]
) -> ConsistencyResult:
    """Check a record by `check_record`; discrepancy: allowed model error as a share of a reading."""
    check = check_record(checked_record, discrepancy, progress)
    finding, words, channels = check.finding, FaultInWords(test, check.stretch, problem.known), test.record.channels
    named = "" if finding.named is None else ": ".join(words.of(finding.named))
    # with several explanations no key is proposed: a wrong one would hide the fault
    candidates = (named,) if named else tuple(_with_odds(words, finding.candidates))
    # in a consistent record a fault that fits slightly better is chance
    best = [finding.best_of(j) if finding.inconsistent else None for j in range(len(test.labels))]
    gain = [0.0 if one is None else one.evidence - finding.without_fault for one in best]
    by_channel = record_from(
        ChannelsChecked,
        finding.check,
        begin=time_of(test, check.part[0]),
        end=time_of(test, check.part[1] - 1),
        fault=tuple("" if one is None else words.of(one)[0] for one in best),
        gain=np.minimum(gain, np.finfo(float).max),
        candidate=candidates,
    )
    if not finding.inconsistent:
        return ConsistencyResult("", "", by_channel)
    ratio = finding.as_it_is.ratio
    if finding.shifted is not None:
        mode, lam = finding.shifted.mode, modal_basis(problem.model, problem.model.reference)[0]
        shift = shift_in_words(mode, float(np.sqrt(lam[mode])) / (2 * np.pi), finding.shifted.factor)
        size = f"a difference of {finding.shifted.size:.2g} σ of tolerances.frequency"
        named = f"{shift}, {size}. {CHECK_MODE.capitalize()}"
    elif finding.pattern is not None:
        named = pattern_in_words(finding.pattern, test.labels)
    if named:
        text, candidates = f": {named}", (named,)
    elif candidates:
        faults = [one.fault for one in finding.candidates if one.fault is not None]
        text = (
            f". Several causes explain this (odds relative to the best; below 1:{np.exp(APART):.0f} omitted): "
            f"{'; '.join(candidates)}. "
            f"{inspection_in_words(faults, channels)} to find the actual cause"
        )
    else:
        size = f"{ratio:.3g} times as large as predicted" if np.isfinite(ratio) else "unbounded"
        text = (
            f": innovations are {size}{_worst_in_words(check, test)}; no single fault of a channel, a known load or the model "
            f"explains the inconsistency. Check {channels}, loads, estimate.start and the model, and compare the configured "
            f"noise with the scatter of readings at rest{_step_in_words(problem, test)}"
        )
    return ConsistencyResult(
        INCONSISTENT + text,
        named,
        replace(by_channel, candidate=candidates),
        birge_ratio=max(1.0, ratio) if np.isfinite(ratio) else 1.0,
    )


def _with_odds(words: FaultInWords, candidates: Sequence[Explained]) -> Iterator[str]:
    """Causes, each with its odds relative to the most likely one."""
    highest = max((one.evidence for one in candidates), default=0.0)
    for one in candidates:
        yield f"{words.of(one)[0]} (odds {np.exp(one.evidence - highest):.2g})"


def _worst_in_words(check: RecordCheck, test: Measured) -> str:
    sample, channel, size = check.worst
    if not size > 0:
        return ""
    return f", the largest innovation is {size:.3g} σ at {time_of(test, sample):.6g} s ({test.labels[channel]})"


def clock_in_words(test: Measured, step: float) -> str:
    """Warning if the sampling interval of a record differs widely from the time step of the config [s], else empty."""
    if max(test.step / step, step / test.step) < OTHER_STEP:
        return ""
    return (
        f"the sampling interval of the record is {test.step:.3g} s, but train.time_step is {step:.3g} s: check "
        "estimate.time.unit"
    )


def _step_in_words(problem: Problem, test: Measured) -> str:
    lam, _ = modal_basis(problem.model, problem.model.reference)
    period = 2 * np.pi / float(np.sqrt(lam[0]))
    if test.step < 0.5 * period:
        return ""
    return f" (sampling interval {test.step:.3g} s, period of the first mode {period:.3g} s: check estimate.time.unit)"


@dataclass(frozen=True)
class Together:
    """Joint estimate of R records.

    alone: parameter → most likely value [SI] from each record (R,); shared: from all records; gain: ln likelihood ratio of common
    against separate parameters and gauges; words: that the records are inconsistent with each other, else empty."""

    alone: dict[str, np.ndarray]
    shared: dict[str, float]
    gain: float
    words: str


def together_of(filters: Sequence[RecordFilter], check_records: Sequence[CheckRecord]) -> Together:
    """Compare the joint evidence of the records with their separate evidence.

        ln p(y₁ … y_R) − Σᵣ ln p(yᵣ)

    It is large for records of one test, and below −MARGIN for records with different parameters or re-bonded gauges. Both terms
    are computed by `peak_of`."""
    unknowns = filters[0].problem.unknowns

    def learning(checked_record: CheckRecord, considered: ConsideredParameters) -> CheckRecord:
        return replace(checked_record, considered=replace(considered, learned=True))

    peaks = [
        find_common_peak([learning(checked_record, checked_record.considered)]) for checked_record in check_records
    ]
    order = np.argsort([record.record for record in filters])
    of_all = find_common_peak([learning(check_records[i], filters[i].considered) for i in order])
    values = {
        name: unknowns.guess[name] * np.exp([peak.point[i] for peak in (*peaks, of_all)])
        for i, name in enumerate(unknowns.parameters)
    }
    gain = float(of_all.evidence - sum(peak.evidence for peak in peaks))
    words, names = "", [record.test.record.name for record in filters]
    if gain < -MARGIN:
        each = [
            f"{name} {', '.join(f'{value:.4g} ({of})' for value, of in zip(row[:-1], names, strict=True))}"
            for name, row in values.items()
        ]
        differing = "; ".join(each) or "gauge errors that differ between the records"
        words = f"the records are inconsistent with each other. Separate estimates: {differing}"
    alone, shared = (
        {name: row[:-1] for name, row in values.items()},
        {name: float(row[-1]) for name, row in values.items()},
    )
    return Together(alone, shared, gain, words)
