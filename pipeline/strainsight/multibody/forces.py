"""Forces: each is conjugate to relations, Q = −∇ρᵀ F, but for the moment; how compiled code calls a force law by its address."""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]

from strainsight.compiled import cfunc, float64, int64, intrinsic, track_dependencies, types
from strainsight.errors import NumericalError
from strainsight.multibody.bodies import Frame
from strainsight.multibody.relations import Relation


class Load(NamedTuple):
    """What a law gives: F (k,) that holds the relations, ∂F/∂ρ (k, k), ∂F/∂ρ̇ (k, k) or None where it does not feel ρ̇, and
    ∂F/∂θ (k, number of the element's parameters and inputs)."""

    F: np.ndarray
    F_rho: np.ndarray
    F_rate: np.ndarray | None
    F_theta: np.ndarray


class ForceLaw(Protocol):
    """F(ρ, ρ̇, θ); what does not depend on ρ̇ is F = ∂Π/∂ρ of an energy Π (for the bearing 1.21-1.25)."""

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        """From ρ (k,) [m, m² or -], ρ̇ = ∇ρ v (k,) a second, θ the element's own parameters, then its inputs. Raises
        NumericalError where there is no such load."""


@runtime_checkable
class CompiledLaw(ForceLaw, Protocol):
    """A law that the step calls without Python; one without these members is called back through `load`, 10 to 30 µs a call.
    address: of a function with SIGNATURE that answers as `load` does, by `compiled_law`, or 0; memory: how many numbers it
    keeps from one trial state to the next, zero at first, on which no answer may depend but by rounding."""

    @property
    def address(self) -> int: ...

    @property
    def memory(self) -> int: ...

    def numbers(self, theta: np.ndarray) -> np.ndarray:
        """What that function takes of the law, for the element's own parameters θ (without inputs). Raises as `load` does."""


class FunctionLaw(ABC):
    """A law that is a function with SIGNATURE, and keeps nothing; refusal: ρ → why it has no load there."""

    function: Callable[..., int]
    refusal: Callable[[np.ndarray], NumericalError]
    memory = 0

    @abstractmethod
    def numbers(self, theta: np.ndarray) -> np.ndarray:
        """As of `CompiledLaw`."""

    @property
    def address(self) -> int:
        return int(compiled_law(self.function).address)

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        k, p = len(rho), len(theta)
        F, F_rho, F_rate, F_theta = np.zeros(k), *np.zeros((2, k, k)), np.zeros((k, p))
        arrays = self.numbers(theta), np.zeros(self.memory), rho, rho_dot, theta, F, F_rho, F_rate, F_theta
        data = [np.ascontiguousarray(array, dtype=float) for array in arrays]
        law = compiled_law(self.function).ctypes
        answer = law(k, p, *(array.ctypes.data_as(_DOUBLES) for array in data))
        if answer == NONE:
            raise self.refusal(rho)
        return Load(F, F_rho, F_rate if answer == MOVING else None, F_theta)


@dataclass(frozen=True)
class RelativeElement:
    """A force law on relations between frames: Q = −∇ρᵀ F(ρ, ρ̇, θ); it gives the bodies the power −F·ρ̇. relations (k):
    their value is subtracted, so ρ is measured from it; parameters: names of θ among the system's; aligned: cosines of axes
    between which the law takes the angle to be small; inputs: names among the system's loads u, whose values the law has
    behind its parameters."""

    name: str
    relations: tuple[Relation, ...]
    law: ForceLaw
    parameters: tuple[str, ...] = ()
    aligned: tuple[Relation, ...] = ()
    inputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class FrameLoad:
    """Σ u_k d_k on a frame, in global axes; directions (3, k), inputs: the names of u_k."""

    name: str
    frame: Frame
    directions: np.ndarray
    inputs: Sequence[str]


class PointForce(FrameLoad):
    """A force at the frame's origin, u_k [N]."""


class PointMoment(FrameLoad):
    """A moment T, u_k [N m]: virtual work T·δθ,  δθ = ½ Σ R_k × δR_k + R Ψ δη."""


@dataclass(frozen=True)
class Gravity:
    """∫ρ g·δp over every body, flexible ones as they deform; acceleration g (3,) [m/s²]."""

    acceleration: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    name: str = "gravity"


Force = RelativeElement | PointForce | PointMoment | Gravity


SIGNATURE = int64(int64, int64, *[types.CPointer(float64)] * 9)  # type: ignore[no-untyped-call]
"""Signature of a force law: law(k, p, numbers, memory, ρ (k), ρ̇ (k), θ (p), F (k), ∂F/∂ρ (k, k), ∂F/∂ρ̇ (k, k), ∂F/∂θ (k,
p)). Outputs are passed as zeros. numbers, memory: of the law (`CompiledLaw`)."""
NONE, STILL, MOVING = 0, 1, 2
"""Its answers: there is no such load; ∂F/∂ρ̇ is zero, and was left alone; all are given."""
ABORT = -1
"""Answer of a law in Python that raised another error than that it has no load."""

_DOUBLES = ctypes.POINTER(ctypes.c_double)
_C = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_int64, *[_DOUBLES] * 9)


@cache
def compiled_law(function: Callable[..., int], *files: str) -> Any:
    """A force law with SIGNATURE that other compiled code calls by its `address`, made when it is first asked for; files as of
    `kept`."""
    return track_dependencies(cfunc(SIGNATURE, cache=True)(function), files)


@intrinsic
def call(typing: Any, address: Any, k: Any, p: Any, *arrays: Any) -> Any:
    """The answer of the law at an address; arrays: their data as addresses (`numbers.ctypes`), in the order of SIGNATURE."""
    whole: Any = types.StarArgTuple  # how numba has *arrays
    arguments: Any = arrays[0] if len(arrays) == 1 and isinstance(arrays[0], types.BaseTuple) else arrays
    signature = types.int64(types.int64, types.int64, types.int64, whole(tuple(arguments)))

    def build(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        integer, pointer = ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(integer, [integer, integer, *[pointer] * 9])
        law = builder.inttoptr(arguments[0], kind.as_pointer())
        data = [builder.inttoptr(builder.extract_value(arguments[3], i), pointer) for i in range(9)]
        return builder.call(law, [arguments[1], arguments[2], *data])

    return signature, build


class InPython:
    """A law that is not compiled, under an address: its `load` is called back. failure: the error that it raised last, which is
    not for compiled code to go round."""

    def __init__(self, law: ForceLaw):
        self.failure: Exception | None = None

        def back(k: int, p: int, *pointers: Any) -> int:
            sizes = ((k,), (k,), (p,), (k,), (k, k), (k, k), (k, p))
            rho, rate, theta, F, F_rho, F_rate, F_theta = (
                np.ctypeslib.as_array(pointer, shape=size) if np.prod(size) else np.zeros(size)
                for pointer, size in zip(pointers[2:], sizes, strict=True)
            )
            try:
                load = law.load(rho.copy(), rate.copy(), theta.copy())
            except NumericalError:
                return NONE
            except Exception as error:  # nothing may pass through compiled code: it is raised behind it
                self.failure = error
                return ABORT
            F[:], F_rho[:], F_theta[:] = load.F, load.F_rho, load.F_theta
            if load.F_rate is None:
                return STILL
            F_rate[:] = load.F_rate
            return MOVING

        self._back = _C(back)

    def pop_failure(self) -> Exception | None:
        """The failure, which is then forgotten."""
        failure, self.failure = self.failure, None
        return failure

    @property
    def address(self) -> int:
        return int(ctypes.cast(self._back, ctypes.c_void_p).value or 0)
