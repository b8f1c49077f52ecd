"""A task in another process, with the warnings that it gives: they are repeated here, where they are shown as all others."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

Heard = tuple[Any, list[tuple[str, type[Warning]]]]


def heard(task: Callable[[Any, Any], Any], shared: Any, point: Any) -> Heard:
    """The result of a task, and its warnings."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        result = task(shared, point)
    return result, [(str(warning.message), warning.category) for warning in said]


def repeated(answer: Heard) -> Any:
    """The result, after its warnings."""
    result, said = answer
    for message, category in said:
        warnings.warn(message, category, stacklevel=3)
    return result
