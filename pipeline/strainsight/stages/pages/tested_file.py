"""The file of a test, in words."""

from __future__ import annotations

import numpy as np

from strainsight.records.estimated import Estimated, Source
from strainsight.report.tested.data import File, FileChannel
from strainsight.stages.pages.tested_readings import step_of

NOTHING = "nothing was done"


def file_of(own: Estimated) -> File:
    """Its name, hash, rate, length and channels with their calibration."""
    source, time = own.source, own.time
    step = step_of(own.gauge.time) if len(own.gauge.time) > 1 else float(time[-1] - time[0])
    return File(
        name=source.file,
        sha256=source.sha256,
        bytes=source.bytes,
        format=source.format,
        date=source.date,
        rate=1 / step,
        start=float(time[0]),
        duration=float(time[-1] - time[0]),
        samples=len(own.gauge.time),
        channels=tuple(
            FileChannel(name, source.measures[i], source.unit[i], calibration_in_words(source, i))
            for i, name in enumerate(source.channel)
        ),
    )


def calibration_in_words(source: Source, i: int) -> str:
    """What was done to channel i of the file, in the order in which it was done."""
    unit, parts = source.unit[i], []
    if source.offset[i]:
        parts.append(f"less {source.offset[i]:g} {unit}")
    if source.drift[i]:
        parts.append(f"less {source.drift[i]:g} {unit} a second")
    if np.isfinite(source.zero[i]).all():
        parts.append("less its mean from {:g} to {:g} s".format(*source.zero[i]))
    if source.sign[i] < 0:
        parts.append("sign turned")
    if source.bridge[i]:
        ratio = "" if np.isnan(source.poisson_ratio[i]) else f", ν {source.poisson_ratio[i]:g}"
        parts.append(f"{source.bridge[i]} bridge, gauge factor {source.gauge_factor[i]:g}{ratio}")
    if source.scale[i] != 1:
        parts.append(f"times {source.scale[i]:g}")
    if source.delay[i]:
        parts.append(f"moved by {abs(source.delay[i]):g} s, {'late' if source.delay[i] > 0 else 'early'} in the file")
    return "; ".join(parts) or NOTHING
