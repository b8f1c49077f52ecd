"""What the placement on a structure writes and prints."""

from __future__ import annotations

from dataclasses import replace

from strainsight.cases.layout.output import layout_output, layout_record
from strainsight.cases.structure.placement import Placement
from strainsight.records.placed import PbhNumbers, Placed
from strainsight.workflow.output import Output, Scalar


def placement_output(found: Placement) -> Output:
    """Datasets, numbers, tables and files."""
    condition, lost, unknowns = found.condition, found.condition.null_direction, found.task.unknowns
    scale = dict(zip(unknowns.names, unknowns.scale.tolist(), strict=True))
    record = Placed(
        **vars(layout_record(found)),
        expected_std={name: std * scale[name] for name, std in found.expected.std.items()},
        without=found.expected.without,
        observability=PbhNumbers(
            condition=condition.condition, sigma_min=condition.sigma_min, condition_raw=condition.condition_raw
        ),
    )
    numbers: dict[str, Scalar] = {"condition": condition.condition} | ({"null_direction": lost} if lost else {})
    output = layout_output(found, record, numbers, {f"/expected_std/{n}": {"scale": size} for n, size in scale.items()})
    return replace(output, message=f"{output.message}, hardly observable: {lost}") if lost else output
