"""What a compiled force law is, and how it is made."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from strainsight.compiled import cfunc, float64, int64, noticing, types

SIGNATURE = int64(int64, int64, *[types.CPointer(float64)] * 9)  # type: ignore[no-untyped-call]
"""Of a force law: answer = law(k, p, numbers, memory, ρ (k), ρ̇ (k), θ (p), F (k), ∂F/∂ρ (k, k), ∂F/∂ρ̇ (k, k), ∂F/∂θ (k, p)); what
it fills is given as zeros. numbers, memory: its own (`CompiledLaw`)."""
NONE, STILL, MOVING = 0, 1, 2
"""Its answers: there is no such load; ∂F/∂ρ̇ is zero, and was left alone; all are given."""


@cache
def compiled_law(function: Callable[..., int], *files: str) -> Any:
    """A force law with SIGNATURE that other compiled code calls by its `address`, made when it is first asked for; files as of
    `kept`."""
    return noticing(cfunc(SIGNATURE, cache=True)(function), files)
