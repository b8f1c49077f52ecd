"""The criteria that a layout can be chosen by."""

from __future__ import annotations

from strainsight.placement.criteria.criterion import Criterion
from strainsight.placement.criteria.determinant import LogDeterminant
from strainsight.placement.criteria.trace import Trace
from strainsight.placement.criteria.worst_eigenvalue import WorstEigenvalue

CRITERIA: tuple[Criterion, ...] = (Trace(), LogDeterminant(), WorstEigenvalue())


def criterion_of(name: str) -> Criterion:
    """The criterion of that name in a config."""
    return next(criterion for criterion in CRITERIA if criterion.name == name)
