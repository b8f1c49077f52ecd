"""What a compiled force law is, how it is made, and how compiled code calls it, or one in Python, by its address."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]

from strainsight.compiled import cfunc, float64, int64, intrinsic, noticing, types
from strainsight.errors import NumericalError
from strainsight.multibody.forces import ForceLaw

SIGNATURE = int64(int64, int64, *[types.CPointer(float64)] * 9)  # type: ignore[no-untyped-call]
"""Of a force law: answer = law(k, p, numbers, memory, ρ (k), ρ̇ (k), θ (p), F (k), ∂F/∂ρ (k, k), ∂F/∂ρ̇ (k, k), ∂F/∂θ (k, p)); what
it fills is given as zeros. numbers, memory: its own (`CompiledLaw`)."""
NONE, STILL, MOVING = 0, 1, 2
"""Its answers: there is no such load; ∂F/∂ρ̇ is zero, and was left alone; all are given."""
ABORT = -1
"""Answer of a law in Python that raised another error than that it has no load."""

_C = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_int64, *[ctypes.POINTER(ctypes.c_double)] * 9)


@cache
def compiled_law(function: Callable[..., int], *files: str) -> Any:
    """A force law with SIGNATURE that other compiled code calls by its `address`, made when it is first asked for; files as of
    `kept`."""
    return noticing(cfunc(SIGNATURE, cache=True)(function), files)


@intrinsic
def call(typing: Any, address: Any, k: Any, p: Any, *arrays: Any) -> Any:
    """The answer of the law at an address; arrays: their data as addresses (`numbers.ctypes`), in the order of SIGNATURE."""
    whole: Any = types.StarArgTuple  # how numba has *arrays
    own: Any = arrays[0] if len(arrays) == 1 and isinstance(arrays[0], types.BaseTuple) else arrays
    signature = types.int64(types.int64, types.int64, types.int64, whole(tuple(own)))

    def build(context: Any, builder: Any, _: Any, given: Any) -> Any:
        integer, pointer = ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(integer, [integer, integer, *[pointer] * 9])
        law = builder.inttoptr(given[0], kind.as_pointer())
        data = [builder.inttoptr(builder.extract_value(given[3], i), pointer) for i in range(9)]
        return builder.call(law, [given[1], given[2], *data])

    return signature, build


class InPython:
    """A law that is not compiled, under an address: its `load` is called back. failure: the error that it raised last, which is
    not for compiled code to go round."""

    def __init__(self, law: ForceLaw):
        self.failure: Exception | None = None

        def back(k: int, p: int, *given: Any) -> int:
            sizes = ((k,), (k,), (p,), (k,), (k, k), (k, k), (k, p))
            rho, rate, theta, F, F_rho, F_rate, F_theta = (
                np.ctypeslib.as_array(own, shape=size) if np.prod(size) else np.zeros(size)
                for own, size in zip(given[2:], sizes, strict=True)
            )
            try:
                found = law.load(rho.copy(), rate.copy(), theta.copy())
            except NumericalError:
                return NONE
            except Exception as error:  # nothing may pass through compiled code: it is raised behind it
                self.failure = error
                return ABORT
            F[:], F_rho[:], F_theta[:] = found.F, found.F_rho, found.F_theta
            if found.F_rate is None:
                return STILL
            F_rate[:] = found.F_rate
            return MOVING

        self._back = _C(back)

    def taken(self) -> Exception | None:
        """The failure, which is then forgotten."""
        failure, self.failure = self.failure, None
        return failure

    @property
    def address(self) -> int:
        return int(ctypes.cast(self._back, ctypes.c_void_p).value or 0)
