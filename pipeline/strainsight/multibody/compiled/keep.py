"""Compiled code that is kept on disk and notices a change of every file that it is made of."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from numba import cfunc, float64, int64, njit, types

F = TypeVar("F", bound=Callable[..., Any])

SIGNATURE = int64(int64, int64, *[types.CPointer(float64)] * 9)  # type: ignore[no-untyped-call]
"""Of a force law: answer = law(k, p, numbers, memory, ρ (k), ρ̇ (k), θ (p), F (k), ∂F/∂ρ (k, k), ∂F/∂ρ̇ (k, k), ∂F/∂θ (k, p)); what
it fills is given as zeros. numbers, memory: its own (`CompiledLaw`)."""
NONE, STILL, MOVING = 0, 1, 2
"""Its answers: there is no such load; ∂F/∂ρ̇ is zero, and was left alone; all are given."""


def kept(*files: str) -> Callable[[F], F]:
    """`njit(cache=True)` of a function that is made of these other files of `multibody`, too: of compiled code that it calls
    (`inner`), and of what its tuples are; what is divided by zero is not finite, which Newton's iteration looks for."""

    def compiled(function: F) -> F:
        return _noticing(njit(cache=True, error_model="numpy")(function), files)

    return compiled


def inner(function: F) -> F:
    """Of compiled code that compiled code alone calls: made and kept with what calls it. A way in from Python, which unpacks
    every array of a system, and a file of its own would take as long again. Called from Python it ends the process."""
    options: Any = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    made: F = njit(**options)(function)
    return made


@cache
def compiled_law(function: Callable[..., int], *files: str) -> Any:
    """A force law with SIGNATURE that other compiled code calls by its `address`, made when it is first asked for; files as of
    `kept`."""
    return _noticing(cfunc(SIGNATURE, cache=True)(function), files)


def _noticing(made: Any, files: tuple[str, ...]) -> Any:
    """numba by itself looks at the time and the size of a function's own file alone."""
    folder = Path(__file__).parents[1]
    index: Any = getattr(getattr(made, "_cache", None), "_cache_file", None)
    if hasattr(index, "_source_stamp"):
        times = tuple((at.st_mtime, at.st_size) for at in ((folder / file).stat() for file in files))
        index._source_stamp = (index._source_stamp, *times)
    return made
