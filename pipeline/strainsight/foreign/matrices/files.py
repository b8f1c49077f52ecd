"""Matrices and tables that another program wrote: OP4, Matrix Market, NumPy and SciPy archives, CalculiX, CSV beside them."""

from __future__ import annotations

import csv
import io
import math
import struct
import zlib
from array import array
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile, ZipInfo

import numpy as np
from numpy.lib import format as npy
from scipy import sparse

from strainsight.decks.text import error_at, no_integer, parse_integer, read_text
from strainsight.errors import DeckError
from strainsight.foreign.matrices.formats import (
    LARGEST,
    MARKERS,
    Column,
    binary_matrices,
    read_calculix,
    read_dofs,
    read_market,
    text_matrices,
)
from strainsight.memory import require_memory
from strainsight.text import plain_cell

SUFFIXES = ".op4, .mtx, .mtx.gz, .npz, .sti, .mas"
SYMMETRIC = 1e-8
"""Largest |X − Xᵀ| over the largest |X| that is rounding of the file."""
NOTED = 1e-12
"""An asymmetry below this is rounding of the sums in memory: nobody need read of it."""
DAMAGE = (
    *(OSError, EOFError, ValueError, TypeError, LookupError, ArithmeticError, AttributeError, NotImplementedError),
    *(BadZipFile, zlib.error, struct.error),
)
"""What the readers of NumPy and SciPy raise on altered bytes."""
AT_ONCE = 2
"""Times what is unpacked that reading holds at once: the arrays, and the matrix that is made of them."""
ENDING = ".npy"
HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
"""Of arrays whose type has no names of columns; matrices have none."""


def read_op4(path: Path, name: str | None = None) -> sparse.csr_array:
    """The matrix of that name (case does not count), or the only one.

    Raises DeckError for a name that is not there, a choice that is left open, complex numbers, a damaged file.
    """
    with path.open("rb") as file:
        binary = MARKERS.get(file.read(4))
    matrices = binary_matrices(path, *binary) if binary else text_matrices(path)
    found = None
    names: list[str] = []
    for header, columns in matrices:
        wanted = header.name.lower() == name.lower() if name else not names
        names.append(header.name)
        if wanted and found is not None:
            raise error_at(path, f"it holds the matrix {header.name} twice", "write every matrix under its own name")
        if wanted:
            found = _collected(header.shape, columns)
        else:
            for _ in columns:
                pass
    if name is None and len(names) > 1:
        raise error_at(path, f"it holds {len(names)} matrices: {', '.join(names)}", "give the name of one")
    if found is None:
        what = f"it holds no matrix {name!r}" if name else "it holds no matrix"
        raise error_at(path, what, f"it has {', '.join(names) or 'none'}")
    return found


def _collected(shape: tuple[int, int], columns: Iterator[Column]) -> sparse.csr_array:
    values, column, row, count = array("d"), array("q"), array("q"), array("q")
    for number, rows, lengths, numbers in columns:
        values.frombytes(memoryview(numbers).cast("B"))
        column.extend([number] * len(rows))
        row.extend(rows)
        count.extend(lengths)
    n = np.array(count, dtype=np.int64)
    within = np.arange(n.sum()) - np.repeat(np.cumsum(n) - n, n)
    entries = np.frombuffer(values) if len(values) else np.zeros(0)
    place = (np.repeat(row, n) - 1 + within, np.repeat(column, n) - 1)
    csr = sparse.csr_array(sparse.coo_array((entries, place), shape=shape).tocsr())
    csr.eliminate_zeros()
    return csr


def read_matrix(path: Path, name: str | None = None) -> sparse.csr_array:
    """A real matrix from a file; `name` which of several (OP4, .npz), None the only one.

    Raises DeckError for a file that is missing, damaged, of another kind, or holds complex numbers, NaN or text, and for
    a name that is not there or is needed. Raises UserError for an archive that memory does not hold unpacked.
    """
    ending = "".join(path.suffixes[-2:]).lower()
    reader = next((r for suffix, r in _READERS.items() if ending.endswith(suffix)), None)
    if reader is None:
        raise error_at(path, f"no matrix file by its name: {path.name}", f"known: {SUFFIXES}")
    try:
        matrix = reader(path, name)
    except FileNotFoundError:
        raise error_at(path, "no such file", "check the name and the folder") from None
    except DeckError as error:
        error.where = error.where or str(path)
        raise
    except DAMAGE as error:
        said = " ".join(str(error).split())[:200]
        raise error_at(path, f"cannot be read: {said}", "write the matrix again") from None
    except MemoryError:
        raise error_at(path, "the matrix does not fit into memory", "write it sparse, or check the file") from None
    if not np.isfinite(matrix.data).all():
        entry = matrix.tocoo()
        first = int(np.argmin(np.isfinite(entry.data)))
        raise error_at(
            path,
            f"entry ({entry.row[first] + 1}, {entry.col[first] + 1}) is {entry.data[first]}",
            "write finite numbers",
        )
    return matrix


def symmetric(X: sparse.csr_array, path: Path) -> tuple[sparse.csr_array, float]:
    """½(X + Xᵀ) and how far X was from it, max|X − Xᵀ| / max|X|.

    Raises DeckError for a matrix that is not square, of which only one triangle is there, or that is off by more than 1e-8.
    """
    if X.shape[0] != X.shape[1]:
        raise error_at(path, f"the matrix has {X.shape[0]} rows and {X.shape[1]} columns", "give a square one")
    apart = abs(X - X.T)
    off = float(apart.max() / (abs(X).max() or 1.0)) if X.nnz else 0.0
    if off == 0.0:
        return X, off
    if off > SYMMETRIC:
        below, above = sparse.tril(X, -1), sparse.triu(X, 1)
        for there, other in ((below, above), (above, below)):
            if abs(there).sum() == 0 and abs(other).sum() > 0:
                which = "lower" if other is below else "upper"
                raise error_at(
                    path,
                    f"only the {which} triangle of the matrix is in the file",
                    "write both triangles, or declare the file symmetric (Matrix Market header)",
                )
        worst = apart.tocoo()
        at = int(np.argmax(worst.data))
        raise error_at(
            path,
            f"the matrix is not symmetric: entries ({worst.row[at] + 1}, {worst.col[at] + 1}) and transposed differ by "
            f"{off:.1e} of the largest entry",
            "a stiffness or mass without gyroscopic, follower or control terms is symmetric",
        )
    return sparse.csr_array(0.5 * (X + X.T)), off


def read_numbering(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """What each row of the matrices is: node id (r,) and component 0-5 (r,), of the lines of a CSV below its header, or of a .dof
    of CalculiX.

    Raises DeckError with file:line for anything but "node,component" or "node.component" lines, a scalar point (component 0),
    and a pair that occurs twice.
    """
    rows, lines = [], []
    calculix = path.suffix.lower() == ".dof"
    for number, cells in read_dofs(path) if calculix else csv_lines(path, ("node", "component")):
        node, component = (_integer(cell, path, number) for cell in cells)
        if component == 0:
            raise error_at(
                f"{path}:{number}",
                f"row {node} is a scalar point (component 0), which has no place in space",
                "condense it into the nodes, or number it as a component of a node of its own",
            )
        if not (1 <= component <= 6 and node >= 1):
            raise error_at(
                f"{path}:{number}",
                f"node {node}, component {component}",
                "components are 1-3 for translations x, y, z and 4-6 for rotations",
            )
        rows.append((node, component - 1))
        lines.append(number)
    pairs = np.array(rows, dtype=np.int64).reshape(-1, 2)
    if len(pairs) == 0:
        raise error_at(path, "no row is numbered", "one line a row: node,component")
    _, first, inverse = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    again = np.flatnonzero(first[inverse.ravel()] != np.arange(len(pairs)))
    if again.size:
        row = int(again[0])
        raise error_at(
            f"{path}:{lines[row]}",
            f"node {pairs[row, 0]}, component {pairs[row, 1] + 1} is numbered twice",
            f"line {lines[int(first[inverse.ravel()[row]])]} has it too: every row has its own",
        )
    return pairs[:, 0], pairs[:, 1]


def csv_lines(path: Path, header: tuple[str, ...]) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of every line below the header, which must say `header` (in any case).

    Raises DeckError with file:line for another header and for lines with more or fewer cells.
    """
    rows = _csv_rows(path)
    while len(rows) > 1 and not any(rows[-1][1]):
        rows.pop()
    wanted, (_, first) = ",".join(header), rows[0]
    if [cell.lower() for cell in first] != list(header):
        raise error_at(f"{path}:1", f"the first line is {','.join(first)[:60]!r}", f"write {wanted!r} there")
    for number, cells in rows[1:]:
        if len(cells) != len(header):
            raise error_at(f"{path}:{number}", f"{','.join(cells)[:60]!r} has {len(cells)} cells", f"give {wanted}")
        yield number, cells


def csv_columns(path: Path, needed: tuple[str, ...]) -> Iterator[tuple[int, dict[str, str]]]:
    """Line number and cells by column of every line below the header that is not blank; other columns are taken along.

    Raises DeckError with file:line for a column of `needed` that is missing, and for lines with more or fewer cells.
    """
    rows = _csv_rows(path)
    header = [cell.lower() for cell in rows[0][1]]
    if missing := [column for column in needed if column not in header]:
        raise error_at(f"{path}:1", f"no column {', '.join(missing)}", f"the first line names them: {','.join(needed)}")
    for number, cells in rows[1:]:
        if not any(cells):
            continue
        if len(cells) != len(header):
            raise error_at(
                f"{path}:{number}", f"{len(cells)} cells under a header of {len(header)}", "give one a column"
            )
        yield number, dict(zip(header, cells, strict=True))


def _csv_rows(path: Path) -> list[tuple[int, list[str]]]:
    """Number of the line where each row begins and its cells, which may hold line breaks in quotes; at least one row."""
    found, line = [], 1
    reader = csv.reader(io.StringIO(read_text(path), newline=""))
    try:
        for cells in reader:
            found.append((line, [plain_cell(cell.strip()) for cell in cells or [""]]))
            line = reader.line_num + 1
    except csv.Error as error:
        raise error_at(f"{path}:{line}", f"is no line of a table: {error}", "check its quotes") from None
    return found or [(1, [""])]


def _integer(cell: str, path: Path, number: int) -> int:
    value = parse_integer(cell)
    if value is None:
        remedy = "give node ids and components"
        raise error_at(f"{path}:{number}", f"an entry {no_integer(cell[:40])}", remedy)
    return value


def _from_matrix_market(path: Path, name: str | None) -> sparse.csr_array:
    if name is not None:
        raise DeckError(f"a Matrix Market file has no matrix names, such as {name!r}", remedy="remove the name")
    return _csr(read_market(path))


def _from_archive(path: Path, name: str | None) -> sparse.csr_array:
    with path.open("rb") as file:
        if file.read(2) != b"PK":
            raise error_at(path, "it is no .npz archive", "write it by scipy.sparse.save_npz or numpy.savez")
    with np.load(path, allow_pickle=False) as archive:
        names = list(archive.files)
        if "format" in names:
            if name is not None:
                raise DeckError(f"a SciPy archive has no matrix names, such as {name!r}", remedy="remove the name")
            require_room(path, names)
            return _csr(sparse.load_npz(path))
        if name is None and len(names) != 1:
            raise error_at(path, f"it holds {len(names)} arrays: {', '.join(names)}", "give the name of one")
        if name is not None and name not in names:
            raise error_at(path, f"it holds no array {name!r}", f"it has {', '.join(names)}")
        require_room(path, [name or names[0]])
        return _csr(archive[name or names[0]])


def _csr(matrix: Any) -> sparse.csr_array:
    if matrix.ndim != 2 or matrix.dtype.kind not in "fiub":
        raise DeckError(
            f"an array of {matrix.ndim} dimensions of {matrix.dtype}", remedy="give a matrix of real numbers"
        )
    if max(matrix.shape) > LARGEST or min(matrix.shape) == 0:
        raise DeckError(f"a matrix of {matrix.shape[0]} × {matrix.shape[1]}", remedy="check how it was written")
    if hasattr(matrix, "check_format"):
        # without the full check indices beyond the matrix would be followed into foreign memory
        matrix.check_format(full_check=True)
    found = sparse.csr_array(matrix).astype(float)
    found.sum_duplicates()
    found.eliminate_zeros()
    return found


_READERS = {
    ".op4": read_op4,
    ".mtx": _from_matrix_market,
    ".mtx.gz": _from_matrix_market,
    ".npz": _from_archive,
    ".sti": read_calculix,
    ".mas": read_calculix,
}


def require_room(path: Path, names: Iterable[str]) -> None:
    """Raise UserError where memory does not hold these arrays of an archive; DeckError where the two headers of one, that of the
    archive and its own, do not agree in its size."""
    with ZipFile(path) as archive:
        wanted = [info for info in archive.infolist() if info.filename.removesuffix(ENDING) in set(names)]
        unpacked = sum(_size(archive, info, path) for info in wanted)
    require_memory(
        AT_ONCE * unpacked,
        f"{path} ({path.stat().st_size / 1e6:.3g} MB) unpacks to {unpacked / 1e6:.4g} MB",
        "write it sparse",
    )


def _size(archive: ZipFile, info: ZipInfo, path: Path) -> int:
    """Bytes that an array unpacks to. Only its header is read, to which numpy sets a limit."""
    with archive.open(info) as stream:
        version = npy.read_magic(stream)
        if version not in HEADERS:
            raise error_at(path, f"{info.filename} is of the version {version} of .npy", "write plain numbers")
        shape, _, dtype = HEADERS[version](stream)
        stated = stream.tell() + math.prod(shape) * dtype.itemsize
    if stated != info.file_size and not dtype.hasobject:
        raise error_at(
            path,
            f"{info.filename} is {info.file_size} bytes by the archive and {stated} by its own header",
            "write the matrix again: the file is damaged, or was made to fill memory",
        )
    return max(stated, info.file_size)
