"""One result of another program: a mode shape, or the response to a static load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from strainsight.mesh.thin import FloatArray, IntArray


@dataclass(frozen=True)
class Response:
    """The motion of nodes in a mode or under a static load, in the units of its file.

    kind; step: number of the step, subcase or data set by which a config asks for it, from 1; number: of the mode within its
    step, from 1, and 1 of a static response; node_ids (n,) of the file, each once, in any order; motion (n, 3) translations
    [length of the file], or (n, 6) with rotations [rad] behind them; frequency [Hz] of a mode, −√|ω²|/2π where ω² < 0, and 0 of a
    static response; label: title of the step or subcase in the words of the file, "" where it has none; modal_mass: ΦᵀMΦ [mass
    of the file, times length² where the shape is a length] where the file states it; along_node_axes: the motion is along the
    displacement axes of each node (CD of a GRID), which the deck states, and not along the basic axes; rounding: largest relative
    error of a number of the file, 5e-6 of 1.23457E+00, 6e-8 in single precision, 1e-16 in double; scalar_points: how many
    points that are no nodes (scalar, fluid) stand among these in the file and are left out; where: file and step, or line, for a
    message; position (n, 3) of the nodes along the basic axes, where the file has them and its reader reads them.
    """

    kind: Literal["mode", "static"]
    step: int
    number: int
    node_ids: IntArray
    motion: FloatArray
    frequency: float = 0.0
    label: str = ""
    modal_mass: float | None = None
    along_node_axes: bool = False
    rounding: float = 6e-8
    scalar_points: int = 0
    where: str = ""
    position: FloatArray | None = None
