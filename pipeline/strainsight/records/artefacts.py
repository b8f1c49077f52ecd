"""Which record each artefact is."""

from __future__ import annotations

from typing import Any

from strainsight.records.mesh import MeshColumns
from strainsight.records.placed import Observed
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.training import Screened, Training

PLACEMENT: dict[str, Any] = {
    "import": MeshColumns,
    "modes": Modes,
    "rom": Reduced,
    "train": Training,
    "screen": Screened,
    "observe": Observed,
    "spectrum": Modes,
}
"""Stage of a placement → the record that it writes, of those that write one."""
