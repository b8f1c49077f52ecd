"""What the placement on a structure writes and prints."""

from __future__ import annotations

from dataclasses import replace

from strainsight.experiment.layout.advice import budget_table
from strainsight.experiment.layout.output import layout_output, layout_record
from strainsight.experiment.structure.candidates import units_in_words
from strainsight.experiment.structure.expectation import case_table
from strainsight.experiment.structure.hot_spots import hot_spot_table
from strainsight.experiment.structure.placement import Placement
from strainsight.experiment.structure.problem import rests_on_loads_in_words
from strainsight.mesh.model import Mesh
from strainsight.records.placed import PbhNumbers, Placed, budget_of_shares
from strainsight.records.record import record_from
from strainsight.runner.output import Output, Scalar, Table


def placement_output(found: Placement, mesh: Mesh, length_unit: str) -> Output:
    """Datasets, numbers, tables and files; length_unit of the deck."""
    condition, lost, unknowns = found.condition, found.condition.null_direction, found.task.unknowns
    scale = dict(zip(unknowns.names, unknowns.scale.tolist(), strict=True))
    by_case = found.by_case
    if by_case is not None:
        scale = {name: float(by_case.scale[name][by_case.name.index(by_case.worst[name])]) for name in unknowns.names}
    budget = found.expected.budget
    record = Placed(
        **vars(layout_record(found)),
        expected_std={name: std * scale[name] for name, std in found.expected.std.items()},
        without=found.expected.without,
        budget=budget_of_shares(budget),
        observability=record_from(PbhNumbers, condition),
        hot_spots=found.hot_spots,
        at_gauges=found.at_gauges,
        by_case=by_case,
    )
    numbers: dict[str, Scalar] = {"condition": condition.condition} | ({"null_direction": lost} if lost else {})
    rests = rests_on_loads_in_words(found.problem)
    numbers |= {"rests_on_loads": rests} if rests else {}
    hot = found.hot_spots
    cases = () if by_case is None else (case_table(by_case, found.task.criterion.symbol),)
    tables: tuple[Table, ...] = (*cases, budget_table(budget))
    if hot is not None:
        numbers |= {"hot_spots": int(hot.hot.sum())}
        tables += (hot_spot_table(hot, found.listed.labels),)
    attributes = {f"/expected_std/{name}": {"scale": size} for name, size in scale.items()}
    unit = units_in_words(found.problem.channels.quantity)
    output = layout_output(found, record, mesh, length_unit, numbers, attributes, tables, unit)
    message = f"{output.message}, hardly observable: {lost}" if lost else output.message
    return replace(output, message=f"{message}; {rests}" if rests else message)
