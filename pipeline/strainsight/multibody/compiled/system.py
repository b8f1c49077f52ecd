"""The compiled form of a system, and what it needs of the parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from strainsight.multibody.compiled.arrays import Arrays, arrays
from strainsight.multibody.compiled.call import InPython
from strainsight.multibody.forces import CompiledLaw, ForceLaw
from strainsight.multibody.system import System

REMEMBERED = 4
"""Values of θ for which what laws need is remembered."""


class Prepared(NamedTuple):
    """K(θ), C(θ) (n, n); of every element the address of its law and where its numbers begin; the numbers."""

    K: np.ndarray
    C: np.ndarray
    address: np.ndarray
    begin: np.ndarray
    numbers: np.ndarray


class Compiled:
    """arrays, memory: numbers that the laws keep; in_python: of every element the law that is called back, or None."""

    def __init__(self, system: System):
        laws = [element.force.law for element in system.elements]
        fast = [law if isinstance(law, CompiledLaw) and law.address else None for law in laws]
        self.in_python = tuple(None if own else InPython(law) for own, law in zip(fast, laws, strict=True))
        kept = [0 if own is None else own.memory for own in fast]
        self.arrays: Arrays = arrays(system, kept)
        self.memory = sum(kept)
        self._prepared: dict[bytes, Prepared] = {}
        self._numbers: list[tuple[bytes, np.ndarray] | None] = [None] * len(laws)

    def at(self, system: System, theta: np.ndarray) -> Prepared:
        """What the step needs of θ (nθ,). Raises the errors of a law that cannot have these parameters."""
        found = self._prepared.get(theta.tobytes())
        if found is None:
            found = self._prepare(system, theta)
            while len(self._prepared) >= REMEMBERED:
                del self._prepared[next(iter(self._prepared))]
            self._prepared[theta.tobytes()] = found
        return found

    def _prepare(self, system: System, theta: np.ndarray) -> Prepared:
        address, begin, numbers, count = [], [], [np.zeros(0)], 0
        for e, (element, back) in enumerate(zip(system.elements, self.in_python, strict=True)):
            law = element.force.law
            own = self._numbers_of(e, law, theta[element.parameters]) if back is None else np.zeros(0)
            address.append(back.address if back is not None else law.address)  # type: ignore[attr-defined]
            begin.append(count)
            numbers.append(own)
            count += len(own)
        K, C = system.at(theta)
        return Prepared(
            np.ascontiguousarray(K),
            np.ascontiguousarray(C),
            np.array(address, dtype=np.int64),
            np.array(begin, dtype=np.int64),
            np.concatenate(numbers),
        )

    def _numbers_of(self, e: int, law: ForceLaw, own: np.ndarray) -> np.ndarray:
        """Those of element e, once for parameters that have not changed."""
        last = self._numbers[e]
        if last is None or last[0] != own.tobytes():
            assert isinstance(law, CompiledLaw)
            last = self._numbers[e] = own.tobytes(), np.asarray(law.numbers(own), dtype=float)
        return last[1]
