"""The placement pipeline: from a deck to a validated layout of gauges."""

from __future__ import annotations

from strainsight.stages.import_mesh import IMPORT
from strainsight.stages.modes import MODES
from strainsight.stages.observe import OBSERVE
from strainsight.stages.place import PLACE
from strainsight.stages.report import REPORT
from strainsight.stages.rom import ROM
from strainsight.stages.screen import SCREEN
from strainsight.stages.train import TRAIN
from strainsight.stages.validate import VALIDATE
from strainsight.workflow.stage import Stage

PLACEMENT = (IMPORT, MODES, ROM, TRAIN, SCREEN, OBSERVE, PLACE, VALIDATE, REPORT)


def stages_for(estimates: bool) -> tuple[Stage, ...]:
    """The pipeline, with the filter on a test where the config names one."""
    if not estimates:
        return PLACEMENT
    from strainsight.stages.estimate import ESTIMATE  # with readers that no other stage needs

    return (*PLACEMENT[:7], ESTIMATE, *PLACEMENT[7:])
