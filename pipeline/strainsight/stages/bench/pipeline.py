"""The pipelines of a bench and of a bearing alone."""

from __future__ import annotations

from strainsight.stages.bench.bearing import BEARING
from strainsight.workflow.stage import Stage


def bench_stages(bearings: bool) -> tuple[Stage, ...]:
    """From the decks to a simulation in time; with the bearings alone where there are any."""
    from strainsight.stages.bench.import_bodies import IMPORT
    from strainsight.stages.bench.reduce import REDUCE
    from strainsight.stages.bench.simulate import SIMULATE

    return (*((BEARING,) * bearings), IMPORT, REDUCE, SIMULATE)


BEARING_ALONE = (BEARING,)
