"""What the placement on a structure writes and prints."""

from __future__ import annotations

from strainsight.cases.layout.advice import advice_table
from strainsight.cases.layout.comparison import criteria_table
from strainsight.cases.layout.gauge_list import gauge_table
from strainsight.cases.layout.output import (
    found_message,
    layout_files,
    layout_record,
    layout_summary,
    pool_grid,
    said_of,
)
from strainsight.cases.structure.placement import Placement
from strainsight.records.placed import PbhNumbers, Placed
from strainsight.records.record import written
from strainsight.workflow.output import Output, Scalar


def placement_output(found: Placement) -> Output:
    """Datasets, numbers, tables and files."""
    grid, attributes = pool_grid(found)
    expected, condition, lost = found.expected, found.condition, found.condition.null_direction
    unknowns = found.task.unknowns
    scale = dict(zip(unknowns.names, unknowns.scale.tolist(), strict=True))
    record = Placed(
        **vars(layout_record(found)),
        expected_std={name: std * scale[name] for name, std in expected.std.items()},
        without=expected.without,
        observability=PbhNumbers(
            condition=condition.condition, sigma_min=condition.sigma_min, condition_raw=condition.condition_raw
        ),
    )
    std: dict[str, Scalar] = {f"std.{name}": value for name, value in expected.std.items()}
    said = ", ".join(f"{name} ± {100 * value:.2g} %" for name, value in expected.std.items())
    own = {"aggregate": found.task.aggregate, "criterion": found.task.metric.criterion.name}
    return Output(
        datasets=grid | written(record, at=said_of(found)),
        attributes=attributes
        | {"/augmented": own}
        | {f"/expected_std/{name}": {"scale": size} for name, size in scale.items()},
        summary=layout_summary(found)
        | {"condition": condition.condition}
        | std
        | ({"null_direction": lost} if lost else {}),
        message=found_message(found, said + f", hardly observable: {lost}" * bool(lost)),
        tables=(
            gauge_table(found.listed, expected.without),
            criteria_table(found.others, unknowns.names, unknowns.scale),
            advice_table(found.advice),
        ),
        files=layout_files(found),
    )
