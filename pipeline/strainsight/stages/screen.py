"""screen: the candidates with the best signal to noise, thinned where they crowd (5.2)."""

from __future__ import annotations

from collections import Counter

import numpy as np

from strainsight.cases.structure.scales import refuse_noise
from strainsight.cases.structure.settings import families
from strainsight.config.gauges import AbsoluteNoise, RelativeNoise
from strainsight.config.placement import Screen
from strainsight.errors import ConfigError, blame
from strainsight.gauges.candidates import Candidates
from strainsight.gauges.screening import Screening, screen
from strainsight.records.record import read, written
from strainsight.records.training import Screened, Training
from strainsight.workflow.output import Output
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """Settle the noise of every channel, drop the weak and the overloaded, thin the clusters."""
    config, training = context.config, read(Training, context.upstream["train"])
    pool, strain = training.candidates, training.reading
    rms, peak = np.sqrt(np.mean(strain**2, axis=0)), np.abs(strain).max(axis=0)
    noise_std, limit = np.empty(len(rms)), np.full(len(rms), np.inf)
    best = {}
    for i, (key, family) in enumerate(families(config).items()):
        own = pool.array == i
        # Of candidates: one glued in a loud place must not make all others noisier.
        free = own & ~pool.glued if (own & ~pool.glued).any() else own
        noise_std[own] = _noise_std(family.noise_std, rms[free], f"{key}.noise_std")
        if own.any():
            best[key] = float(rms[own].max()), float(noise_std[own][0])
        if family.range is not None:
            limit[own] = family.range
    refuse_noise(best)
    with blame("screen.keep"):
        result = _screened(config.screen, pool, rms, peak, noise_std, limit)
    dropped = Counter(str(code) for code in result.reason if code)
    unit = 1e6 * noise_std[0] if pool.quantity[0] == 0 else noise_std[0]
    screened = Screened(
        kept=result.kept,
        snr=result.snr,
        reason=np.asarray(result.reason, dtype=np.str_),
        noise_std=noise_std,
        range=limit,
        family=tuple(key.removeprefix("motion_sensors.") for key in families(config)),
    )
    return Output(
        datasets=written(screened),
        summary={"candidates": pool.gauges, "kept": len(result.kept), "noise_std": float(noise_std[0])}
        | {f"dropped.{code}": count for code, count in dropped.items()},
        message=f"{pool.gauges} → {len(result.kept)}, noise {unit:.3g} {'µm/m' if pool.quantity[0] == 0 else ''}".rstrip(),
    )


def _screened(
    settings: Screen, pool: Candidates, rms: np.ndarray, peak: np.ndarray, noise_std: np.ndarray, limit: np.ndarray
) -> Screening:
    """Every kind of sensor by itself: the best accelerometers would else leave no room for a gauge."""
    keep = None if settings.keep == "all" else settings.keep
    kinds = pool.array[pool.first]
    kept, snr, reason = [], np.empty(pool.gauges), np.empty(pool.gauges, dtype="<U7")
    for kind in np.unique(kinds):
        gauges, own = np.flatnonzero(kinds == kind), np.flatnonzero(pool.array == kind)
        # Of a kind that has fewer all are kept; of one alone that is an error, as it was asked for.
        most = keep if keep is None or len(np.unique(kinds)) == 1 else min(keep, len(gauges))
        found = screen(
            rms[own],
            noise_std[own],
            pool.position[own],
            most,
            settings.minimum_spacing,
            gauge=np.searchsorted(gauges, pool.gauge[own]),
            glued=pool.glued[own],
            largest=peak[own],
            limit=limit[own],
        )
        kept.append(gauges[found.kept])
        snr[gauges], reason[gauges] = found.snr, found.reason
    return Screening(np.sort(np.concatenate(kept)), snr, reason)


def _noise_std(stated: AbsoluteNoise | RelativeNoise, rms: np.ndarray, key: str) -> float:
    """σ of a family of sensors: as stated, or a share of its strongest candidate."""
    if isinstance(stated, AbsoluteNoise):
        return stated.value
    strongest = float(rms.max())
    if strongest <= 0:
        raise ConfigError(
            "no candidate reads anything in the training run, of which the noise would be a share",
            key=key,
            remedy="give {value: …}, or load the structure",
        )
    return stated.relative_to_strongest * strongest


SCREEN = Stage(
    "screen",
    version=3,
    reads=(
        "screen",
        "gauges.noise_std",
        "gauges.range",
        "motion_sensors.*.noise_std",
        "motion_sensors.*.range",
    ),
    upstream=("train",),
    files=(),
    run=run,
)
