"""A task in another process, with its warnings captured: they are repeated here, where they are shown as all others."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

Captured = tuple[Any, list[tuple[str, type[Warning]]]]


def captured(task: Callable[[Any, Any], Any], shared: Any, point: Any) -> Captured:
    """The result of a task, and its warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = task(shared, point)
    return result, [(str(warning.message), warning.category) for warning in caught]


def repeated(answer: Captured) -> Any:
    """The result, after its warnings."""
    result, caught = answer
    for message, category in caught:
        warnings.warn(message, category, stacklevel=3)
    return result
