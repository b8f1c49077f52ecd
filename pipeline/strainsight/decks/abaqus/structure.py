"""What stands where in a deck: parts, instances and their places, steps, and the model around them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.decks.abaqus.text import Keyword
from strainsight.mesh.model import FloatArray

MESH = ("NODE", "ELEMENT")
SECTIONS = ("SOLIDSECTION", "SHELLSECTION", "SHELLGENERALSECTION", "BEAMSECTION", "BEAMGENERALSECTION")


@dataclass(frozen=True)
class Step:
    """A *STEP and its keywords; number from 1."""

    number: int
    keyword: Keyword
    keywords: tuple[Keyword, ...]


def read_structure(
    keywords: list[Keyword],
) -> tuple[tuple[Keyword, ...], dict[str, tuple[Keyword, ...]], list[tuple[Keyword, tuple[Keyword, ...]]], list[Step]]:
    """Keywords of the model itself, of each part, of each instance with its *INSTANCE, and the steps."""
    model: list[Keyword] = []
    parts: dict[str, tuple[Keyword, ...]] = {}
    instances: list[tuple[Keyword, tuple[Keyword, ...]]] = []
    named: set[str] = set()
    steps: list[Step] = []
    opened: list[tuple[Keyword, list[Keyword]]] = []
    inside = {"PART": (), "ASSEMBLY": (), "INSTANCE": ("ASSEMBLY",), "STEP": ()}
    for keyword in keywords:
        name = keyword.name
        if name in inside:
            above = tuple(k.name for k, _ in opened)
            if above != inside[name]:
                raise keyword.error(
                    f"stands inside {opened[-1][0].title} at {opened[-1][0].where}"
                    if opened
                    else "stands outside *ASSEMBLY",
                    f"close it with *END {opened[-1][0].name} before"
                    if opened
                    else "put it between *ASSEMBLY and its end",
                )
            opened.append((keyword, []))
        elif name.startswith("END") and name[3:] in inside:
            if not opened or opened[-1][0].name != name[3:]:
                raise keyword.error(f"there is no *{name[3:]} to end", "remove the line, or add what it ends")
            start, own = opened.pop()
            if start.name == "PART":
                part_name = start.needs("NAME")
                if part_name.upper() in parts:
                    raise start.error(f"part {part_name!r} stands twice", "give every part its own name")
                parts[part_name.upper()] = tuple(own)
            elif start.name == "INSTANCE":
                if start.needs("NAME").upper() in named:
                    raise start.error(f"instance {start.needs('NAME')!r} stands twice", "give it its own name")
                named.add(start.needs("NAME").upper())
                instances.append((start, tuple(own)))
            elif start.name == "STEP":
                steps.append(Step(len(steps) + 1, start, tuple(own)))
        elif opened and opened[-1][0].name != "ASSEMBLY":
            if opened[-1][0].name == "STEP" and name in (*MESH, *SECTIONS, "MATERIAL"):
                raise keyword.error("stands inside a *STEP", "move it before the first *STEP")
            # Sets of a step are sets of the model.
            (model if name in ("NSET", "ELSET", "SURFACE") and opened[-1][0].name == "STEP" else opened[-1][1]).append(
                keyword
            )
        else:
            model.append(keyword)
    if opened:
        start = opened[-1][0]
        raise start.error(f"no *END {start.name} follows", "the deck may be cut off: write it again")
    if parts and not instances:
        start = next(k for k in keywords if k.name == "PART")
        raise start.error("there is no *INSTANCE of any part", "add an *ASSEMBLY with the instances")
    return tuple(model), parts, instances, steps


def placement(keyword: Keyword) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and translation (3,) of an *INSTANCE: first the translation, then the rotation about an axis of the
    assembly. Rodrigues: R = I + sin φ [n×] + (1 − cos φ) [n×]²."""
    rows = keyword.rows(needed=False)
    turns = [row for row in rows if any(row.entries[3:])]
    shifts = [row for row in rows if not any(row.entries[3:])]
    if len(turns) > 1 or len(shifts) > 1:
        raise rows[-1].error("more lines than a translation and a rotation", "give x, y, z and then the axis and angle")
    shift = shifts[0].reals(3, "a translation") if shifts else np.zeros(3)
    if not turns:
        return np.eye(3), shift
    values = turns[0].reals(7, "a coordinate of the axis, or the angle")
    a, axis = values[:3], values[3:6] - values[:3]
    if not np.linalg.norm(axis) > 0:
        raise turns[0].error("the two points of the axis coincide", "give two points, and the angle in degrees")
    n, angle = axis / np.linalg.norm(axis), np.radians(values[6])
    cross = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    R = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
    return R, a + R @ (shift - a)
