"""Nodes, elements and geometrical entities in a gmsh file, as formats 2 and 4 write them.

Source: gmsh reference manual, "MSH file format", "MSH file format version 2 (Legacy)" and "version 4".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.decks.gmsh.elements import TYPES
from strainsight.decks.gmsh.numbers import Binary, Numbers, Text
from strainsight.mesh.model import FloatArray, IntArray


@dataclass(frozen=True)
class NodeRows:
    """Nodes: ids (n,), position (n, 3), line (n,) in the file or None."""

    ids: IntArray
    position: FloatArray
    line: IntArray | None


NO_NODES = NodeRows(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), None)


@dataclass(frozen=True)
class Chunk:
    """Elements of one type in the same physical groups: ids (n,), nodes (n, k) by their numbers in gmsh's order,
    groups the tags of the physical groups, line (n,) in the file or None."""

    type: int
    ids: IntArray
    nodes: IntArray
    groups: tuple[int, ...]
    line: IntArray | None


def _together(parts: list[IntArray | None]) -> IntArray | None:
    given = [part for part in parts if part is not None]
    return np.concatenate(given) if given else None


def _nodes_of(source: Numbers, number: int) -> int:
    if number not in TYPES:
        raise source.error(f"element type {number} is unknown", "mesh with elements of first or second order")
    return TYPES[number].nodes


def nodes_2(source: Numbers, count: int, parametric: bool) -> NodeRows:
    """Rows of number x y z; parametric ones go on with dimension, entity and parameters, which are left."""
    if not parametric:
        ids, position = source.rows(count, 3)
        return NodeRows(ids, position, source.lines(count, 4))
    if isinstance(source, Binary):
        raise source.error("binary parametric nodes of format 2 are not supported", "save with Mesh.SaveParametric = 0")
    ids, position = np.zeros(0, np.int64), np.zeros((0, 3))
    lines = np.zeros(0, np.int64)
    every_ids, every_position, every_line = [ids], [position], [lines]
    for _ in range(count):
        one, row = source.rows(1, 5)
        line = source.lines(1, 6)
        dimension = int(row[0, 3])
        source.take("double", dimension if dimension in (1, 2) else 0)
        every_ids.append(one)
        every_position.append(row[:, :3])
        every_line.append(line if line is not None else lines)
    return NodeRows(np.concatenate(every_ids), np.concatenate(every_position), np.concatenate(every_line))


def nodes_4(source: Numbers, version: str) -> NodeRows:
    """Blocks of nodes, one a geometrical entity; parameters on the entity are left."""
    latest = version == "4.1"
    blocks, total = (int(n) for n in source.take("size", 4 if latest else 2)[:2])
    ids, position, line = [np.zeros(0, np.int64)], [np.zeros((0, 3))], []
    for _ in range(blocks):
        header = source.take("int", 3)
        dimension, parametric = int(header[0 if latest else 1]), int(header[2])
        if not 0 <= dimension <= 3 or parametric not in (0, 1):
            raise source.error(f"a block of nodes on an entity of dimension {dimension}, parametric {parametric}")
        count = int(source.take("size", 1)[0])
        width = 3 + (dimension if parametric else 0)
        if latest:
            ids.append(source.take("size", count))
            position.append(source.take("double", count * width).reshape(count, width)[:, :3])
            line.append(source.lines(count, width))
        else:
            numbers, x = source.rows(count, width)
            ids.append(numbers)
            position.append(x[:, :3])
            line.append(source.lines(count, 1 + width))
    found = sum(map(len, ids))
    if found != total:
        raise source.error(f"{total} nodes are claimed, the blocks hold {found}")
    return NodeRows(np.concatenate(ids), np.concatenate(position), _together(line))


def entity_groups(source: Numbers, version: str) -> dict[tuple[int, int], tuple[int, ...]]:
    """(dimension, tag) of a geometrical entity → tags of its physical groups.

    A negative tag reverses the orientation of the group's elements and means the same group.
    """
    found: dict[tuple[int, int], tuple[int, ...]] = {}
    counts = source.take("size", 4)
    for dimension in range(4):
        for _ in range(int(counts[dimension])):
            tag = int(source.take("int", 1)[0])
            source.take("double", 3 if dimension == 0 and version == "4.1" else 6)
            groups = source.take("int", int(source.take("size", 1)[0]))
            found[dimension, tag] = tuple(dict.fromkeys(abs(int(group)) for group in groups))
            if dimension:
                source.take("int", int(source.take("size", 1)[0]))
    return found


def elements_4(source: Numbers, version: str, groups: dict[tuple[int, int], tuple[int, ...]]) -> list[Chunk]:
    """Blocks of elements, one a geometrical entity and type."""
    latest = version == "4.1"
    blocks, total = (int(n) for n in source.take("size", 4 if latest else 2)[:2])
    chunks = []
    for _ in range(blocks):
        first, second, number = (int(n) for n in source.take("int", 3))
        width = 1 + _nodes_of(source, number)
        count = int(source.take("size", 1)[0])
        table = source.take("size" if latest else "int", count * width).reshape(count, width)
        own = groups.get((TYPES[number].dimension, second if latest else first), ())
        chunks.append(Chunk(number, table[:, 0], table[:, 1:], own, source.lines(count, width)))
    found = sum(len(chunk.ids) for chunk in chunks)
    if found != total:
        raise source.error(f"{total} elements are claimed, the blocks hold {found}")
    return chunks


def elements_2(source: Numbers, count: int) -> list[Chunk]:
    """Rows of number, type, tags, nodes (text), or type, how many follow, tags, and those rows (binary).

    The first tag is the physical group, 0 for none.
    """
    chunks: list[Chunk] = []
    done = 0
    if not isinstance(source, Text):
        return _elements_2_binary(source, count)
    values = source.values
    while done < count:
        source.start = source.at
        if len(values) - source.at < 3:
            raise source.error(f"{count} elements are claimed, {done} are there")
        number, tags = (int(n) for n in source.take("int", 3)[1:])
        source.at = source.start
        width = 3 + _tags(source, tags) + _nodes_of(source, number)
        rows = _alike(values, source.at, width, slice(1, 3), count - done)
        table = source.take("int", max(rows, 1) * width).reshape(-1, width)
        chunks += _by_group(number, table[:, 0], table[:, 3:], tags, source.lines(len(table), width))
        done += len(table)
    return chunks


def _elements_2_binary(source: Binary, count: int) -> list[Chunk]:
    chunks: list[Chunk] = []
    done = 0
    while done < count:
        values, begin = source.rest(), source.at
        number, follow, tags = (int(n) for n in source.take("int", 3))
        width = 1 + _tags(source, tags) + _nodes_of(source, number)
        if not 1 <= follow <= count - done:
            raise source.error(f"a block of {follow} elements where {count - done} are left")
        if follow > 1:
            table = source.take("int", follow * width).reshape(follow, width)
        else:
            # gmsh writes a header before every element
            rows = max(_alike(values, 0, 3 + width, slice(0, 3), count - done), 1)
            source.at = begin
            table = source.take("int", rows * (3 + width)).reshape(rows, 3 + width)[:, 3:]
        chunks += _by_group(number, table[:, 0], table[:, 1:], tags, None)
        done += len(table)
    return chunks


def _tags(source: Numbers, tags: int) -> int:
    if not 0 <= tags <= 1000:
        raise source.error(f"an element with {tags} tags")
    return tags


def _alike(values: np.ndarray, at: int, width: int, columns: slice, most: int) -> int:
    """How many rows of `width` from `at` on agree with the first in these columns."""
    most = min(most, (len(values) - at) // width)
    rows = 1
    while rows < most:
        more = min(2 * rows, most)
        head = values[at : at + more * width].reshape(more, width)[:, columns]
        same = np.all(head == head[0], axis=1)
        if not same.all():
            return int(np.argmin(same))
        rows = more
    return min(rows, most)


def _by_group(number: int, ids: IntArray, rest: IntArray, tags: int, line: IntArray | None) -> list[Chunk]:
    """Split rows of tags and nodes by their physical group."""
    group = np.abs(rest[:, 0]) if tags else np.zeros(len(rest), dtype=np.int64)
    chunks = []
    for tag in np.unique(group):
        own = group == tag
        lines = None if line is None else line[own]
        chunks.append(Chunk(number, ids[own], rest[own, tags:], (int(tag),) if tag else (), lines))
    return chunks
