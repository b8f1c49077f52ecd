"""The placement pipeline: from a deck to a validated layout of gauges."""

from __future__ import annotations

from dataclasses import replace

from strainsight.runner.stage import Stage
from strainsight.stages.import_mesh import IMPORT
from strainsight.stages.place import PLACE
from strainsight.stages.report import REPORT
from strainsight.stages.rom import MODES, ROM, SPECTRUM
from strainsight.stages.train import OBSERVE, SCREEN, TRAIN
from strainsight.stages.validate import VALIDATE

PLACEMENT = (IMPORT, MODES, ROM, TRAIN, SCREEN, OBSERVE, PLACE, SPECTRUM, VALIDATE, REPORT)


def stages_for(estimates: bool, truth: str) -> tuple[Stage, ...]:
    """The pipeline: with the filter on a test where the config names one, with a spectrum where the truth is made of modes."""
    stages: tuple[Stage, ...] = PLACEMENT
    if truth not in ("modes", "perturbed"):
        validate = replace(VALIDATE, upstream=tuple(name for name in VALIDATE.upstream if name != SPECTRUM.name))
        stages = tuple(validate if stage is VALIDATE else stage for stage in stages if stage is not SPECTRUM)
    if not estimates:
        return stages
    from strainsight.stages.estimate import ESTIMATE  # with readers that no other stage needs
    from strainsight.stages.measurement_report import TEST

    place = stages.index(PLACE) + 1
    linked = replace(REPORT, upstream=(*REPORT.upstream, ESTIMATE.name))
    rest = tuple(linked if stage is REPORT else stage for stage in stages[place:])
    return (*stages[:place], ESTIMATE, TEST, *rest)
