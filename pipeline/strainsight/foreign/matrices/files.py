"""Matrices and tables of other programs: OP4, Matrix Market, NumPy and SciPy archives, CalculiX, and CSV files."""

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

from strainsight.decks.text import describe_non_integer, error_at, parse_integer, read_text
from strainsight.errors import DeckError
from strainsight.foreign.matrices.calculix import read_calculix, read_dofs
from strainsight.foreign.matrices.formats import LARGEST, MARKERS, Column, binary_matrices, read_market, text_matrices
from strainsight.memory import require_memory
from strainsight.text import plain_cell

SUFFIXES = ".op4, .mtx, .mtx.gz, .npz, .sti, .mas"
SYMMETRIC = 1e-8
"""Largest |X − Xᵀ| over the largest |X| that counts as rounding error."""
NOTED = 1e-12
"""Asymmetry below which no note is given."""
DAMAGE = (
    *(OSError, EOFError, ValueError, TypeError, LookupError, ArithmeticError, AttributeError, NotImplementedError),
    *(BadZipFile, zlib.error, struct.error),
)
"""Errors of NumPy and SciPy for damaged bytes."""
AT_ONCE = 2
"""Memory for reading, in units of the unpacked size: the arrays and the matrix."""
ENDING = ".npy"
HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
"""Readers of headers without column names, which matrices do not have."""


def read_op4(path: Path, name: str | None = None) -> sparse.csr_array:
    """The matrix of that name (in any case), or the only matrix. Raises DeckError for a missing or ambiguous name, complex
    numbers and a damaged file."""
    with path.open("rb") as file:
        binary = MARKERS.get(file.read(4))
    matrices = binary_matrices(path, *binary) if binary else text_matrices(path)
    matrix = None
    names: list[str] = []
    for header, columns in matrices:
        wanted = header.name.lower() == name.lower() if name else not names
        names.append(header.name)
        if wanted and matrix is not None:
            raise error_at(
                path, f"the file contains the matrix {header.name} twice", "give each matrix of the file its own name"
            )
        if wanted:
            matrix = _collect_columns(header.shape, columns)
        else:
            for _ in columns:
                pass
    if name is None and len(names) > 1:
        raise error_at(
            path, f"the file contains {len(names)} matrices: {', '.join(names)}", "set `name` to one of them"
        )
    if matrix is None:
        what = f"the file contains no matrix {name!r}" if name else "the file contains no matrix"
        raise error_at(path, what, f"set `name` to one of {', '.join(names)}" if names else "export the matrix again")
    return matrix


def _collect_columns(shape: tuple[int, int], columns: Iterator[Column]) -> sparse.csr_array:
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
    """A real matrix from a file; `name` selects one of several (OP4, .npz), None the only one.

    Raises DeckError for a file that is missing, damaged or unsupported, for complex numbers, NaN or text, and for a
    missing or required name. Raises UserError for an archive that does not fit into memory."""
    ending = "".join(path.suffixes[-2:]).lower()
    reader = next((r for suffix, r in _READERS.items() if ending.endswith(suffix)), None)
    if reader is None:
        raise error_at(path, f"{path.name} is not a known matrix file", f"use one of these file endings: {SUFFIXES}")
    try:
        matrix = reader(path, name)
    except FileNotFoundError:
        raise error_at(path, "no such file", "correct the file name or the folder") from None
    except DeckError as error:
        error.where = error.where or str(path)
        raise
    except DAMAGE as error:
        message = " ".join(str(error).split())[:200]
        raise error_at(path, f"the file cannot be read: {message}", "export the matrix again") from None
    except MemoryError:
        raise error_at(path, "the matrix does not fit into memory", "write the matrix in sparse form") from None
    if not np.isfinite(matrix.data).all():
        entry = matrix.tocoo()
        first = int(np.argmin(np.isfinite(entry.data)))
        raise error_at(
            path,
            f"matrix entry ({entry.row[first] + 1}, {entry.col[first] + 1}) is {entry.data[first]}",
            "export the matrix with finite numbers only",
        )
    return matrix


def symmetric(X: sparse.csr_array, path: Path) -> tuple[sparse.csr_array, float]:
    """½(X + Xᵀ), and the asymmetry max|X − Xᵀ| / max|X| of X. Raises DeckError for a matrix that is not square, has only one
    triangle, or has an asymmetry above 1e-8."""
    if X.shape[0] != X.shape[1]:
        raise error_at(path, f"the matrix has {X.shape[0]} rows and {X.shape[1]} columns", "specify a square matrix")
    difference = abs(X - X.T)
    off = float(difference.max() / (abs(X).max() or 1.0)) if X.nnz else 0.0
    if off == 0.0:
        return X, off
    if off > SYMMETRIC:
        below, above = sparse.tril(X, -1), sparse.triu(X, 1)
        for triangle, other in ((below, above), (above, below)):
            if abs(triangle).sum() == 0 and abs(other).sum() > 0:
                which = "lower" if other is below else "upper"
                raise error_at(
                    path,
                    f"the file contains only the {which} triangle of the matrix",
                    "write both triangles, or declare the matrix symmetric (Matrix Market header)",
                )
        worst = difference.tocoo()
        at = int(np.argmax(worst.data))
        raise error_at(
            path,
            f"the matrix is not symmetric: entry ({worst.row[at] + 1}, {worst.col[at] + 1}) and its transpose "
            f"differ by {off:.1e} of the largest entry",
            "remove gyroscopic, follower-force and control terms; stiffness and mass must be symmetric",
        )
    return sparse.csr_array(0.5 * (X + X.T)), off


def read_numbering(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Node id (r,) and component 0-5 (r,) of each matrix row, from the lines of a CSV below its header, or a .dof of CalculiX.

    Raises DeckError with file:line for lines other than "node,component" or "node.component", a scalar point
    (component 0) and a duplicate pair."""
    rows, lines = [], []
    calculix = path.suffix.lower() == ".dof"
    for number, cells in read_dofs(path) if calculix else csv_lines(path, ("node", "component")):
        node, component = (_integer(cell, path, number) for cell in cells)
        if component == 0:
            raise error_at(
                f"{path}:{number}",
                f"point {node} is a scalar point (component 0), which has no position",
                "remove the scalar point by static condensation, or number it as a component of a separate node",
            )
        if not (1 <= component <= 6 and node >= 1):
            raise error_at(
                f"{path}:{number}",
                f"node {node}, component {component} is not a valid row",
                "use components 1-3 for translations x, y, z and 4-6 for rotations",
            )
        rows.append((node, component - 1))
        lines.append(number)
    pairs = np.array(rows, dtype=np.int64).reshape(-1, 2)
    if len(pairs) == 0:
        raise error_at(
            path,
            "the file assigns no node and component to a matrix row",
            "write one line node,component for each matrix row",
        )
    _, first, inverse = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    if (again := np.flatnonzero(first[inverse.ravel()] != np.arange(len(pairs)))).size:
        row = int(again[0])
        raise error_at(
            f"{path}:{lines[row]}",
            f"node {pairs[row, 0]}, component {pairs[row, 1] + 1} is assigned to two matrix rows",
            f"correct this line or line {lines[int(first[inverse.ravel()[row]])]}, so that every row is unique",
        )
    return pairs[:, 0], pairs[:, 1]


def csv_lines(path: Path, header: tuple[str, ...]) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of every line below the header, which must equal `header` (in any case). Raises DeckError with
    file:line for another header and for lines with a wrong number of cells."""
    rows = _csv_rows(path)
    while len(rows) > 1 and not any(rows[-1][1]):
        rows.pop()
    wanted, (_, first) = ",".join(header), rows[0]
    if [cell.lower() for cell in first] != list(header):
        raise error_at(
            f"{path}:1", f"the first line is {','.join(first)[:60]!r}", f"write the header {wanted!r} in the first line"
        )
    for number, cells in rows[1:]:
        if len(cells) != len(header):
            what = f"the number of cells in the line {','.join(cells)[:60]!r} is {len(cells)}, not {len(header)}"
            raise error_at(f"{path}:{number}", what, f"write the cells {wanted} in each line")
        yield number, cells


def csv_columns(path: Path, needed: tuple[str, ...]) -> Iterator[tuple[int, dict[str, str]]]:
    """Line number and cells by column of every non-blank line below the header, including additional columns. Raises DeckError
    with file:line for a missing column of `needed`, and for lines with a wrong number of cells."""
    rows = _csv_rows(path)
    header = [cell.lower() for cell in rows[0][1]]
    if missing := [column for column in needed if column not in header]:
        raise error_at(
            f"{path}:1",
            f"column missing: {', '.join(missing)}",
            f"add the column names to the first line: {','.join(needed)}",
        )
    for number, cells in rows[1:]:
        if not any(cells):
            continue
        if len(cells) != len(header):
            raise error_at(
                f"{path}:{number}",
                f"the line has {len(cells)} cells, but the header has {len(header)}",
                "write one cell for each column",
            )
        yield number, dict(zip(header, cells, strict=True))


def _csv_rows(path: Path) -> list[tuple[int, list[str]]]:
    """First line number and cells of each row, which may contain line breaks in quotes; at least one row."""
    rows, line = [], 1
    reader = csv.reader(io.StringIO(read_text(path), newline=""))
    try:
        for cells in reader:
            rows.append((line, [plain_cell(cell.strip()) for cell in cells or [""]]))
            line = reader.line_num + 1
    except csv.Error as error:
        raise error_at(
            f"{path}:{line}", f"the line is not a valid table row: {error}", "correct the quotation marks"
        ) from None
    return rows or [(1, [""])]


def _integer(cell: str, path: Path, number: int) -> int:
    if (value := parse_integer(cell)) is None:
        remedy = "write node ids and components as integers"
        raise error_at(f"{path}:{number}", describe_non_integer("the node id or component", cell[:40]), remedy)
    return value


def _from_matrix_market(path: Path, name: str | None) -> sparse.csr_array:
    if name is not None:
        raise DeckError(f"a Matrix Market file has no matrix names such as {name!r}", remedy="remove `name`")
    return _csr(read_market(path))


def _from_archive(path: Path, name: str | None) -> sparse.csr_array:
    with path.open("rb") as file:
        if file.read(2) != b"PK":
            raise error_at(
                path, "the file is not an .npz archive", "save the matrix with scipy.sparse.save_npz or numpy.savez"
            )
    with np.load(path, allow_pickle=False) as archive:
        names = list(archive.files)
        if "format" in names:
            if name is not None:
                raise DeckError(f"a SciPy archive has no matrix names such as {name!r}", remedy="remove `name`")
            require_room(path, names)
            return _csr(sparse.load_npz(path))
        if name is None and len(names) != 1:
            raise error_at(
                path, f"the file contains {len(names)} arrays: {', '.join(names)}", "set `name` to one of them"
            )
        if name is not None and name not in names:
            raise error_at(path, f"the file contains no array {name!r}", f"set `name` to one of {', '.join(names)}")
        require_room(path, [name or names[0]])
        return _csr(archive[name or names[0]])


def _csr(matrix: Any) -> sparse.csr_array:
    if matrix.ndim != 2 or matrix.dtype.kind not in "fiub":
        what = f"the number of dimensions of the array is {matrix.ndim}, and its type is {matrix.dtype}"
        raise DeckError(what, remedy="save a two-dimensional array of real numbers")
    if max(matrix.shape) > LARGEST or min(matrix.shape) == 0:
        raise DeckError(
            f"the matrix size {matrix.shape[0]} × {matrix.shape[1]} is not valid",
            remedy=f"export a matrix with 1 to {LARGEST} rows and columns",
        )
    if hasattr(matrix, "check_format"):
        # without the full check, invalid indices would access memory outside the matrix
        matrix.check_format(full_check=True)
    csr = sparse.csr_array(matrix).astype(float)
    csr.sum_duplicates()
    csr.eliminate_zeros()
    return csr


_READERS = {
    ".op4": read_op4,
    ".mtx": _from_matrix_market,
    ".mtx.gz": _from_matrix_market,
    ".npz": _from_archive,
    ".sti": read_calculix,
    ".mas": read_calculix,
}


def require_room(path: Path, names: Iterable[str]) -> None:
    """Raise UserError if these arrays of an archive do not fit into memory; DeckError if the two headers of an array
    disagree on its size."""
    with ZipFile(path) as archive:
        wanted = [info for info in archive.infolist() if info.filename.removesuffix(ENDING) in set(names)]
        unpacked = sum(_size(archive, info, path) for info in wanted)
    require_memory(
        AT_ONCE * unpacked,
        f"{path} ({path.stat().st_size / 1e6:.3g} MB) unpacks to {unpacked / 1e6:.4g} MB",
        "write the matrix in sparse form",
    )


def _size(archive: ZipFile, info: ZipInfo, path: Path) -> int:
    """Unpacked size of an array [bytes], from its header only."""
    with archive.open(info) as stream:
        version = npy.read_magic(stream)
        if version not in HEADERS:
            raise error_at(
                path,
                f"{info.filename} has the .npy version {version}, not 1.0 or 2.0",
                "save a plain numeric array (without field names) with numpy.savez",
            )
        shape, _, dtype = HEADERS[version](stream)
        header_size = stream.tell() + math.prod(shape) * dtype.itemsize
    if header_size != info.file_size and not dtype.hasobject:
        raise error_at(
            path,
            f"{info.filename} has {info.file_size} bytes in the archive, but {header_size} according to its header",
            "the file is damaged or manipulated: export the matrix again",
        )
    return max(header_size, info.file_size)
