"""Nodes, elements and geometrical entities in a gmsh file, formats 2 and 4.

Source: gmsh reference manual, "MSH file format", "MSH file format version 2 (Legacy)", "version 4" and "Node ordering"."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from strainsight.decks.text import error_at
from strainsight.errors import DeckError
from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.model import FloatArray, IntArray
from strainsight.mesh.thin import concatenate


class ElementType(NamedTuple):
    """An element type: name, dimension of its geometry, number of nodes."""

    name: str
    dimension: int
    nodes: int


_SHAPES: Mapping[tuple[str, int], Mapping[int, int]] = {
    ("point", 0): {15: 1},
    ("line", 1): {1: 2, 8: 3, 26: 4, 27: 5, 28: 6},
    ("triangle", 2): {2: 3, 9: 6, 20: 9, 21: 10, 22: 12, 23: 15, 25: 21},
    ("incomplete triangle", 2): {24: 15},
    ("quadrangle", 2): {3: 4, 10: 9, 16: 8, 36: 16, 37: 25, 38: 36, 39: 12, 41: 20},
    ("incomplete quadrangle", 2): {40: 16},
    ("tetrahedron", 3): {4: 4, 11: 10, 29: 20, 30: 35, 31: 56, 32: 22, 33: 28},
    ("hexahedron", 3): {5: 8, 12: 27, 17: 20, 92: 64, 93: 125, 99: 32, 100: 44},
    ("prism", 3): {6: 6, 13: 18, 18: 15, 90: 40, 91: 75},
    ("pyramid", 3): {7: 5, 14: 14, 19: 13, 118: 30, 119: 55, 125: 21},
}
"""Shape and dimension → type number → number of nodes."""
TYPES: Mapping[int, ElementType] = {
    number: ElementType(f"{nodes}-node {shape}" if dimension else shape, dimension, nodes)
    for (shape, dimension), types in _SHAPES.items()
    for number, nodes in types.items()
}
"""Number → type, up to the fifth order of lines and surfaces."""

KINDS = {kind.gmsh: kind for kind in ELEMENTS if kind.gmsh}
"""Supported solids."""


def remedy(number: int) -> str:
    """Remedy for an unsupported solid."""
    if "pyramid" in TYPES[number].name:
        return (
            "set Mesh.ElementOrder = 1 (only linear pyramids are supported), or avoid pyramids: use only "
            "tetrahedra (Mesh.RecombineAll = 0), or hexahedra from transfinite volumes"
        )
    if number in (12, 13):
        return "set Mesh.SecondOrderIncomplete = 1 before meshing: 20-node hexahedra and 15-node prisms are supported"
    return "set Mesh.ElementOrder = 2 (or 1) before meshing"


LARGEST_NUMBER = 2.0**53
"""Largest number up to which a double represents every integer."""


class Text:
    """Numbers of a text section with body `body`, which begins at line `line` of the file.

    Raises DeckError with the line for entries that are not numbers, and for missing numbers."""

    def __init__(self, body: bytes, path: str, name: str, line: int):
        self.path, self.name, self.line = path, name, line
        lines = body.split(b"\n")
        self._ends = np.cumsum([len(text.split()) for text in lines])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            try:
                self.values: FloatArray = np.fromstring(body, sep=" ")
            except ValueError:
                self.values = np.zeros(0)
        if len(self.values) != self._ends[-1]:
            self._find_word(lines)
        self.start = self.at = 0

    def _find_word(self, lines: list[bytes]) -> None:
        for number, text in enumerate(lines, self.line):
            for word in text.split():
                try:
                    np.array(word, dtype="S40").astype(float)
                except ValueError:
                    raise self._error(f"{word[:40].decode('latin-1')!r} is not a number", number) from None
        raise self._error("the numbers of a line are not separated by blanks", self.line)

    def take(self, kind: str, count: int) -> np.ndarray:
        """The next numbers: kind "double", or "int" and "size" for integers. Returns (count,)."""
        self.start = self.at
        if not 0 <= count <= len(self.values) - self.at:
            left = len(self.values) - self.at
            raise self.error(f"the section must contain {count} more numbers, but contains only {left}")
        self.at += count
        values = self.values[self.start : self.at]
        if kind == "double":
            return values
        return self._integers(values, 1, "an integer")

    def rows(self, count: int, reals: int) -> tuple[IntArray, FloatArray]:
        """The next rows of one integer and `reals` other numbers: (count,) and (count, reals)."""
        table = self.take("double", count * (1 + reals)).reshape(count, 1 + reals)
        return self._integers(table[:, 0], 1 + reals, "a node number"), table[:, 1:]

    def _integers(self, values: FloatArray, width: int, what: str) -> IntArray:
        """Values taken last, each the first of a row of `width` numbers, as integers."""
        whole = (values == np.floor(values)) & (np.abs(values) < LARGEST_NUMBER)
        if not whole.all():
            self.start += int(np.argmin(whole)) * width
            raise self.error(f"{self.values[self.start]:g} is not {what}")
        return values.astype(np.int64)

    def lines(self, count: int, width: int) -> IntArray | None:
        """Line of each of the last `count` rows of `width` numbers."""
        begin = self.start + width * np.arange(count)
        return np.searchsorted(self._ends, begin, side="right").astype(np.int64) + self.line

    def error(self, what: str, remedy: str = "the file is damaged or truncated: export the mesh again") -> DeckError:
        """An error at the line of the numbers read last."""
        begin = min(self.start, max(len(self.values) - 1, 0))
        return self._error(what, int(np.searchsorted(self._ends, begin, side="right")) + self.line, remedy)

    def _error(self, what: str, line: int, remedy: str = "correct the line, or export the mesh again") -> DeckError:
        return error_at(f"{self.path}:{line}", f"${self.name}: {what}", remedy)

    def finish(self) -> None:
        """Raise DeckError for surplus numbers."""
        if self.at < len(self.values):
            self.start = self.at
            raise self.error(f"the section contains {len(self.values) - self.at} numbers after its last entry")


class Binary:
    """Numbers of a binary section that begins at byte `at` of the file; order "<" or ">", size [bytes] of a size_t.

    Raises DeckError with the section for missing numbers."""

    def __init__(self, content: bytes, at: int, path: str, name: str, order: str, size: int):
        # a file that ends after its count has no further bytes
        self.content, self.at, self.path, self.name = content, min(at, len(content)), path, name
        self.types = {
            "int": np.dtype(f"{order}i4"),
            "size": np.dtype(f"{order}u{size}"),
            "double": np.dtype(f"{order}f8"),
        }

    def take(self, kind: str, count: int) -> np.ndarray:
        """The next numbers: kind "double", "int" or "size". Returns (count,)."""
        values = self._raw(self.types[kind], count)
        if kind == "double":
            return values.astype(np.float64)
        whole = values.astype(np.int64)
        if kind == "size" and np.any(whole < 0):
            raise self.error("a number exceeds 2⁶³")
        return whole

    def rows(self, count: int, reals: int) -> tuple[IntArray, FloatArray]:
        """The next rows of one integer and `reals` other numbers: (count,) and (count, reals)."""
        table = self._raw(np.dtype([("id", self.types["int"]), ("x", self.types["double"], (reals,))]), count)
        return table["id"].astype(np.int64), table["x"].astype(np.float64)

    def _raw(self, dtype: np.dtype, count: int) -> np.ndarray:
        left = (len(self.content) - self.at) // dtype.itemsize
        if not 0 <= count <= left:
            raise self.error(f"the section must contain {count} more entries, but the file contains at most {left}")
        values = np.frombuffer(self.content, dtype, count, self.at) if count else np.zeros(0, dtype)
        self.at += count * dtype.itemsize
        return values

    def rest(self) -> np.ndarray:
        """All following bytes as integers, without advancing."""
        count = (len(self.content) - self.at) // 4
        return np.frombuffer(self.content, self.types["int"], count, self.at) if count else np.zeros(0, np.int32)

    def lines(self, count: int, width: int) -> IntArray | None:
        """None: binary sections have no lines."""
        return None

    def error(self, what: str, remedy: str = "the file is damaged or truncated: export the mesh again") -> DeckError:
        """An error in this section."""
        return error_at(self.path, f"${self.name}: {what}", remedy)

    def finish(self) -> None:
        """Raise DeckError unless the section ends here."""
        if not self.content[self.at : self.at + 40].lstrip().startswith(b"$End" + self.name.encode()):
            raise self.error(f"$End{self.name} is missing after the last entry")


Numbers = Text | Binary


@dataclass(frozen=True)
class NodeRows:
    """Nodes: ids (n,), position (n, 3), line (n,) in the file or None."""

    ids: IntArray
    position: FloatArray
    line: IntArray | None


NO_NODES = NodeRows(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), None)


@dataclass(frozen=True)
class Chunk:
    """Elements of one type in the same physical groups: ids (n,), node numbers (n, k) in gmsh's order, tags of the
    groups, line (n,) in the file or None."""

    type: int
    ids: IntArray
    nodes: IntArray
    groups: tuple[int, ...]
    line: IntArray | None

    @property
    def kind(self) -> ElementType:
        """Type of the elements."""
        return TYPES[self.type]


def _join_nodes(parts: list[NodeRows]) -> NodeRows:
    lines = [part.line for part in parts if part.line is not None]
    return NodeRows(
        concatenate(part.ids for part in parts),
        np.concatenate([np.zeros((0, 3)), *(part.position for part in parts)]),
        np.concatenate(lines) if lines else None,
    )


def _nodes_of(source: Numbers, number: int) -> int:
    if number not in TYPES:
        raise source.error(f"element type {number} is unknown", "use elements of first or second order")
    return TYPES[number].nodes


def nodes_2(source: Numbers, count: int, parametric: bool) -> NodeRows:
    """Read rows "number x y z"; dimension, entity and parameters of parametric nodes are skipped."""
    if not parametric:
        ids, position = source.rows(count, 3)
        return NodeRows(ids, position, source.lines(count, 4))
    if isinstance(source, Binary):
        raise source.error(
            "binary parametric nodes of format 2 are not supported",
            "set Mesh.SaveParametric = 0 and save the mesh again",
        )
    parts = []
    for _ in range(count):
        ids, row = source.rows(1, 5)
        parts.append(NodeRows(ids, row[:, :3], source.lines(1, 6)))
        source.take("double", int(row[0, 3]) if row[0, 3] in (1, 2) else 0)
    return _join_nodes(parts)


def nodes_4(source: Numbers, version: str) -> NodeRows:
    """Read blocks of nodes, one for each geometrical entity; parameters are skipped."""
    latest = version == "4.1"
    blocks, total = (int(n) for n in source.take("size", 4 if latest else 2)[:2])
    parts = []
    for _ in range(blocks):
        header = source.take("int", 3)
        dimension, parametric = int(header[0 if latest else 1]), int(header[2])
        if not 0 <= dimension <= 3 or parametric not in (0, 1):
            raise source.error(
                f"a block has the dimension {dimension} (0 to 3 allowed) and the parametric flag {parametric} (0 or 1 allowed)"
            )
        count = int(source.take("size", 1)[0])
        width = 3 + (dimension if parametric else 0)
        if latest:
            ids = source.take("size", count)
            x = source.take("double", count * width).reshape(count, width)
        else:
            ids, x = source.rows(count, width)
        parts.append(NodeRows(ids, x[:, :3], source.lines(count, width if latest else 1 + width)))
    count_in_blocks = sum(len(part.ids) for part in parts)
    if count_in_blocks != total:
        raise source.error(f"the section declares {total} nodes, but its blocks contain {count_in_blocks}")
    return _join_nodes(parts)


def entity_groups(source: Numbers, version: str) -> dict[tuple[int, int], tuple[int, ...]]:
    """(dimension, tag) of a geometrical entity → tags of its physical groups. A negative tag denotes the same group with
    reversed element orientation."""
    groups_of_entity: dict[tuple[int, int], tuple[int, ...]] = {}
    counts = source.take("size", 4)
    for dimension in range(4):
        for _ in range(int(counts[dimension])):
            tag = int(source.take("int", 1)[0])
            source.take("double", 3 if dimension == 0 and version == "4.1" else 6)
            groups = source.take("int", int(source.take("size", 1)[0]))
            groups_of_entity[dimension, tag] = tuple(dict.fromkeys(abs(int(group)) for group in groups))
            if dimension:
                source.take("int", int(source.take("size", 1)[0]))
    return groups_of_entity


def elements_4(source: Numbers, version: str, groups: dict[tuple[int, int], tuple[int, ...]]) -> list[Chunk]:
    """Read blocks of elements, one for each geometrical entity and type."""
    latest = version == "4.1"
    blocks, total = (int(n) for n in source.take("size", 4 if latest else 2)[:2])
    chunks = []
    for _ in range(blocks):
        first, second, number = (int(n) for n in source.take("int", 3))
        width = 1 + _nodes_of(source, number)
        count = int(source.take("size", 1)[0])
        table = source.take("size" if latest else "int", count * width).reshape(count, width)
        entity_tags = groups.get((TYPES[number].dimension, second if latest else first), ())
        chunks.append(Chunk(number, table[:, 0], table[:, 1:], entity_tags, source.lines(count, width)))
    count_in_blocks = sum(len(chunk.ids) for chunk in chunks)
    if count_in_blocks != total:
        raise source.error(f"the section declares {total} elements, but its blocks contain {count_in_blocks}")
    return chunks


def elements_2(source: Numbers, count: int) -> list[Chunk]:
    """Read rows of number, type, tags, nodes (text), or type, count, tags, and the rows (binary). The first tag is the physical
    group, 0 for none."""
    chunks: list[Chunk] = []
    done = 0
    if not isinstance(source, Text):
        return _elements_2_binary(source, count)
    values = source.values
    while done < count:
        source.start = source.at
        if len(values) - source.at < 3:
            raise source.error(f"the section declares {count} elements, but contains only {done}")
        number, tags = (int(n) for n in source.take("int", 3)[1:])
        source.at = source.start
        width = 3 + _tags(source, tags) + _nodes_of(source, number)
        rows = _count_equal_rows(values, source.at, width, slice(1, 3), count - done)
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
            raise source.error(
                f"a block declares {follow} elements, but must contain 1 to {count - done} in this section"
            )
        if follow > 1:
            table = source.take("int", follow * width).reshape(follow, width)
        else:
            # gmsh writes a header before every element
            rows = max(_count_equal_rows(values, 0, 3 + width, slice(0, 3), count - done), 1)
            source.at = begin
            table = source.take("int", rows * (3 + width)).reshape(rows, 3 + width)[:, 3:]
        chunks += _by_group(number, table[:, 0], table[:, 1:], tags, None)
        done += len(table)
    return chunks


def _tags(source: Numbers, tags: int) -> int:
    if not 0 <= tags <= 1000:
        raise source.error(f"an element has {tags} tags; 0 to 1000 are allowed")
    return tags


def _count_equal_rows(values: np.ndarray, at: int, width: int, columns: slice, most: int) -> int:
    """Number of rows of `width` from `at` that equal the first row in these columns."""
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
    """Split rows of tags and nodes by physical group."""
    group = np.abs(rest[:, 0]) if tags else np.zeros(len(rest), dtype=np.int64)
    chunks = []
    for tag in np.unique(group):
        in_group = group == tag
        lines = None if line is None else line[in_group]
        chunks.append(Chunk(number, ids[in_group], rest[in_group, tags:], (int(tag),) if tag else (), lines))
    return chunks
