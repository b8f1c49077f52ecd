"""The compiled form of a system, and what it needs of the parameters."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from strainsight.multibody.compiled.arrays import Arrays, Point, arrays, natural
from strainsight.multibody.compiled.law import InPython
from strainsight.multibody.forces import CompiledLaw, ForceLaw
from strainsight.multibody.system import System

NONE = np.zeros(0)
REMEMBERED = 4
"""Values of θ for which what laws need is remembered."""


class Compiled:
    """arrays with their pattern, natural: of the step, of `balance`; memory: how many numbers the laws keep; in_python: of every
    element the law that is called back, or None."""

    def __init__(self, system: System):
        laws = [element.force.law for element in system.elements]
        fast = [law if isinstance(law, CompiledLaw) and law.address else None for law in laws]
        self.in_python = tuple(None if own else InPython(law) for own, law in zip(fast, laws, strict=True))
        kept = [0 if own is None else own.memory for own in fast]
        self.arrays, self.pattern = arrays(system, kept)
        self.natural: Arrays = natural(system, self.arrays)
        self.memory = sum(kept)
        self._prepared: dict[bytes, Point] = {}
        self._numbers: list[tuple[bytes, np.ndarray] | None] = [None] * len(laws)

    def failure(self) -> Exception | None:
        """The error of a law in Python at which compiled code stopped."""
        return next(filter(None, [law.taken() for law in self.in_python if law is not None]), None)

    def at(self, system: System, theta: np.ndarray) -> Point:
        """A point with all that depends on θ (nθ,), and without a state. Raises the errors of a law that cannot have these
        parameters."""
        found = self._prepared.get(theta.tobytes())
        if found is None:
            found = self._prepare(system, theta)
            while len(self._prepared) >= REMEMBERED:
                del self._prepared[next(iter(self._prepared))]
            self._prepared[theta.tobytes()] = found
        return found

    def _prepare(self, system: System, theta: np.ndarray) -> Point:
        address, begin, numbers, count = [], [], [np.zeros(0)], 0
        for e, (element, back) in enumerate(zip(system.elements, self.in_python, strict=True)):
            law = element.force.law
            own = self._numbers_of(e, law, theta[element.parameters]) if back is None else np.zeros(0)
            address.append(back.address if back is not None else law.address)  # type: ignore[attr-defined]
            begin.append(count)
            numbers.append(own)
            count += len(own)
        K, C = system.at(theta)
        return Point(
            NONE, NONE, 1.0, NONE, np.ascontiguousarray(K), np.ascontiguousarray(C), NONE, np.array(address, dtype=np.int64),
            np.array(begin, dtype=np.int64), np.concatenate(numbers),
        )  # fmt: skip

    def _numbers_of(self, e: int, law: ForceLaw, own: np.ndarray) -> np.ndarray:
        """Those of element e, once for parameters that have not changed."""
        last = self._numbers[e]
        if last is None or last[0] != own.tobytes():
            assert isinstance(law, CompiledLaw)
            last = self._numbers[e] = own.tobytes(), np.asarray(law.numbers(own), dtype=float)
        return last[1]


_compiled: WeakKeyDictionary[System, Compiled] = WeakKeyDictionary()


def compiled(system: System) -> Compiled:
    """The compiled form of a system, made once."""
    found = _compiled.get(system)
    if found is None:
        found = _compiled[system] = Compiled(system)
    return found
