"""The placement pipeline: from a deck to a validated layout of gauges."""

from __future__ import annotations

from strainsight.stages.import_mesh import IMPORT
from strainsight.stages.place import PLACE
from strainsight.stages.report import REPORT
from strainsight.stages.rom import ROM
from strainsight.stages.screen import SCREEN
from strainsight.stages.train import TRAIN
from strainsight.stages.validate import VALIDATE

PLACEMENT = (IMPORT, ROM, TRAIN, SCREEN, PLACE, VALIDATE, REPORT)
