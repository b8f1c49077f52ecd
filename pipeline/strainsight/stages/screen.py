"""screen: the candidates with the best signal to noise, thinned where they crowd (5.2)."""

from __future__ import annotations

from collections import Counter

import numpy as np

from strainsight.errors import blame
from strainsight.gauges.screening import screen
from strainsight.workflow.output import Dataset, Output
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """Settle the one noise level of all gauges, drop the weak, thin the clusters."""
    config, train = context.config, context.upstream["train"]
    rms = np.sqrt(np.mean(train["/strain"] ** 2, axis=0))
    stated = config.gauges.noise_std
    noise_std = float(stated["value"]) if "value" in stated else float(stated.relative_to_strongest * rms.max())
    keep = None if config.screen.keep == "all" else int(config.screen.keep)
    with blame("screen.keep"):
        result = screen(rms, noise_std, train["/gauges/position"], keep, config.screen.minimum_spacing)
    dropped = Counter(str(code) for code in result.reason if code)
    return Output(
        datasets={
            "/kept": Dataset(result.kept, "1", "index of every kept candidate, ascending"),
            "/snr": Dataset(result.snr, "1", "RMS training strain over noise of every candidate"),
            "/reason": Dataset(
                np.asarray(result.reason, dtype=np.str_), "1", "why a candidate was dropped; empty where it was kept"
            ),
            "/noise_std": Dataset(np.array(noise_std), "strain", "noise of one gauge sample at the training time step"),
        },
        summary={"candidates": len(rms), "kept": len(result.kept), "noise_std": noise_std}
        | {f"dropped.{code}": count for code, count in dropped.items()},
        message=f"{len(rms)} → {len(result.kept)}, noise {1e6 * noise_std:.3g} µm/m",
    )


SCREEN = Stage(
    "screen",
    version=1,
    reads=("screen", "gauges.noise_std"),
    upstream=("train",),
    files=(),
    run=run,
)
