"""The sections of a gmsh file, formats 2.0 to 2.2, 4.0 and 4.1, text and binary."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from strainsight.decks.gmsh.records import (
    NO_NODES,
    Binary,
    Chunk,
    NodeRows,
    Numbers,
    Text,
    elements_2,
    elements_4,
    entity_groups,
    nodes_2,
    nodes_4,
)
from strainsight.decks.text import UNPACKING, error_at, open_file, parse_integer, read_bytes
from strainsight.errors import DeckError
from strainsight.mesh.model import IdTable

_HEADER = re.compile(rb"\$(\w+)[ \t]*\r?\n")
_BLANKS = re.compile(rb"\s*")
_NAME = re.compile(r'\s*(\d+)\s+(-?\d+)\s+"(.*)"\s*')
_READ = ("PhysicalNames", "Entities", "Nodes", "ParametricNodes", "Elements")


@dataclass
class GmshFile:
    """Contents of a file: version "2.2"; names (dimension, physical tag) → name; nodes; elements; sections that are not read."""

    path: str
    version: str = ""
    names: dict[tuple[int, int], str] = field(default_factory=dict)
    nodes: NodeRows = NO_NODES
    elements: list[Chunk] = field(default_factory=list)
    skipped: Counter[str] = field(default_factory=Counter)

    @cached_property
    def table(self) -> IdTable:
        """Node number → row."""
        return IdTable(self.nodes.ids)

    def where(self, what: str, number: int) -> str:
        """Line of the last "node" or "element" with this number, or the file if it is binary."""
        for rows in [self.nodes] if what == "node" else reversed(self.elements):
            hits = np.flatnonzero(rows.ids == number)
            if hits.size and rows.line is not None:
                return f"{self.path}:{rows.line[hits[-1]]}"
        return self.path


def is_gmsh(path: Path) -> bool:
    """Whether a file begins like a gmsh file, with a section ($MeshFormat, $Comments); ANSYS writes another kind of .msh."""
    try:
        with open_file(Path(path)) as file:
            return re.match(rb"(\xef\xbb\xbf)?\s*\$[A-Za-z]", file.read(200)) is not None
    except (OSError, *UNPACKING):
        return False


class GmshReader:
    """Reader of the sections of a gmsh file, unpacked if its name ends in .gz. Raises DeckError for a file that is missing,
    empty, damaged or has an unsupported version."""

    def __init__(self, path: Path):
        self.content, self.path = read_bytes(path).removeprefix(b"\xef\xbb\xbf"), str(path)
        self.file = GmshFile(self.path)
        self.groups: dict[tuple[int, int], tuple[int, ...]] = {}
        self.binary, self.order, self.size = False, "<", 8

    def read(self) -> GmshFile:
        at, section_names = 0, set[str]()
        while (at := _BLANKS.match(self.content, at).end()) < len(self.content):  # type: ignore[union-attr]
            if not (header := _HEADER.match(self.content, at)):
                raise self._error("the line is not the start of a section, such as $Nodes", at)
            name = header[1].decode("latin-1")
            if not self.file.version and name not in ("MeshFormat", "Comments"):
                old = name in ("NOD", "ELM", "PARA", "PTS")
                what = "gmsh format 1 is not supported" if old else f"${name} is not allowed before $MeshFormat"
                raise self._error(what, at, _SAVE)
            key = name.removeprefix("Parametric")
            if key in section_names and key in (*_READ, "MeshFormat"):
                raise self._error(f"the section ${name} occurs twice", at, "keep only one mesh in the file")
            section_names.add(key)
            at = self._section(name, header.end())
        if not self.file.version:
            raise self._error("the section $MeshFormat is missing", 0, _SAVE)
        for key in ("Nodes", "Elements"):
            if key not in section_names:
                raise self._error(f"the section ${key} is missing", 0)
        return self.file

    def _section(self, name: str, start: int) -> int:
        """Read the section whose body begins at byte `start`; returns the start of the next one."""
        if self.binary and name in ("Entities", "Nodes", "ParametricNodes", "Elements"):
            end = self._read_numbers(name, start, b"")
        else:
            end = self.content.find(b"$End" + name.encode("latin-1"), start)
            if end < 0:
                raise self._error(f"the line $End{name} is missing: the file is truncated", start - 1)
            body = self.content[start:end]
            if name == "MeshFormat":
                self._format(body, start)
            elif name == "PhysicalNames":
                self._names(body, start)
            elif name in _READ:
                self._read_numbers(name, start, body)
            elif name != "Comments":
                self.file.skipped[f"${name}"] += 1
        return end + len("$End" + name)

    def _format(self, body: bytes, start: int) -> None:
        first, _, rest = body.lstrip().partition(b"\n")
        words = first.decode("latin-1").split()
        if len(words) != 3 or words[1] not in ("0", "1") or words[2] not in ("4", "8"):
            raise self._error("$MeshFormat is not valid; expected, for example, '4.1 0 8'", start)
        if words[0] not in ("2", "2.0", "2.1", "2.2", "4", "4.0", "4.1"):
            raise self._error(f"gmsh format {words[0]} is not supported", start, _SAVE)
        self.file.version = words[0] if "." in words[0] else words[0] + ".0"
        self.binary, self.size = words[1] == "1", int(words[2])
        if self.binary:
            if rest[:4] not in (b"\1\0\0\0", b"\0\0\0\1"):
                raise self._error("$MeshFormat must contain the binary integer 1, which defines the byte order", start)
            self.order = "<" if rest[0] else ">"

    def _names(self, body: bytes, start: int) -> None:
        rows = [(n, row) for n, row in enumerate(body.split(b"\n"), self._line(start)) if row.strip()]
        for number, row in rows[1:]:
            text = row.decode("utf-8", "replace")
            match = _NAME.fullmatch(text)
            dimension, tag = (parse_integer(match[i]) for i in (1, 2)) if match else (None, None)
            if not match or dimension not in (0, 1, 2, 3) or tag is None:
                raise error_at(
                    f"{self.path}:{number}",
                    f"$PhysicalNames: {text.strip()[:60]!r} is not valid; expected, for example, '3 1 \"hub\"'",
                    "correct the line",
                )
            self.file.names[dimension, tag] = match[3]
        claimed = rows[0][1].strip() if rows else b""
        if claimed != str(len(rows) - 1).encode():
            text = claimed[:20].decode("latin-1")
            raise self._error(f"$PhysicalNames declares {text!r} names, but contains {max(len(rows) - 1, 0)}", start)

    def _read_numbers(self, name: str, start: int, body: bytes) -> int:
        """Read a section of numbers; returns its end."""
        source: Numbers
        old = self.file.version.startswith("2")
        if self.binary:
            count = 0
            if old:
                first = self.content[start : start + 30].partition(b"\n")[0]
                if not first.strip().isdigit():
                    raise self._error(f"${name} must begin with the number of entries", start)
                count, start = int(first), start + len(first) + 1
            source = Binary(self.content, start, self.path, name, self.order, self.size)
        else:
            source = Text(body, self.path, name, self._line(start))
            count = int(source.take("size", 1)[0]) if old else 0
        match name:
            case "Entities":
                self.groups = entity_groups(source, self.file.version)
            case "Elements":
                chunks = elements_2(source, count) if old else elements_4(source, self.file.version, self.groups)
                self.file.elements = chunks
            case _:
                parametric = name == "ParametricNodes"
                self.file.nodes = nodes_2(source, count, parametric) if old else nodes_4(source, self.file.version)
        source.finish()
        if not self.binary:
            return start + len(body)
        return self.content.index(b"$End" + name.encode(), source.at)

    def _line(self, at: int) -> int:
        return self.content.count(b"\n", 0, at) + 1

    def _error(self, what: str, at: int, remedy: str = "the file is damaged: export the mesh again") -> DeckError:
        where = self.path if self.binary and at > 200 else f"{self.path}:{self._line(at)}"
        return error_at(where, what, remedy)


_SAVE = "save the mesh with Mesh.MshFileVersion = 4.1 (or 2.2)"
