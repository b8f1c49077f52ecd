"""What doctor looks at: packages, solver, rendering, threads, memory, disk, terminal."""

from __future__ import annotations

import math
import os
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from strainsight.errors import UserError
from strainsight_cli.trials import tried

GOOD, WARNING, FAILS = "good", "warning", "fails"
GIB = 2.0**30
PEAKS = ((9_000, 0.15), (27_972, 0.31), (98_010, 1.03), (314_262, 4.11), (983_250, 17.4))
"""Unknowns → most memory held [GiB] by import, matrices, factor and 20 modes of a compact mesh: docs/measured.md."""
SYMBOLS = "→ ↩ σ µ ₃ ≤ ·"
LEAST_MEMORY, SOME_MEMORY = 0.4, 2.0
"""[GiB] What the smallest example takes, and what the coarse hub with its simulations does not need all of."""
LEAST_DISK, SOME_DISK = 0.1, 2.0
"""[GiB] of free disk."""
ACCURATE = 1e-9


@dataclass(frozen=True)
class Finding:
    """What was looked at, the verdict, what was found, and what to do where it is not good."""

    subject: str
    verdict: str
    found: str
    remedy: str = ""


def check_solver() -> list[Finding]:
    """The sparse solver on a small system, in a process that may crash."""
    found, ended = tried("solver")
    install = "pip install --force-reinstall pypardiso mkl (x86-64 only)"
    if "solver" not in found:
        return [Finding("solver", FAILS, ended or "no result", "pip install --force-reinstall numpy scipy pypardiso")]
    text = f"{found['solver']}, {found['unknowns']} unknowns in {found['seconds']:.2f} s, error {found['error']:.1e}"
    if not found["error"] < ACCURATE:
        return [Finding("solver", FAILS, f"{text}: wrong", "pip install --force-reinstall numpy scipy pypardiso")]
    if found["solver"] != "PARDISO":
        why = f" ({found['why']})" if found.get("why") else ""
        meaning = "many times slower, and refuses more than 100 000 unknowns"
        return [Finding("solver", WARNING, f"{text}; PARDISO cannot be loaded{why}: {meaning}", install)]
    return [Finding("solver", GOOD, text)]


def check_mpi() -> list[Finding]:
    """What `solver: slepc` needs: none of it is missed by other configs, so that its absence is good news, too."""
    from strainsight.contrib.mpi.session import programs

    try:
        found = programs()
    except UserError as error:
        return [Finding("solver: slepc", GOOD, f"not here, for very large models only: {error.what}")]
    return [Finding("solver: slepc", GOOD, f"{' '.join(found.launcher)}, {found.python}")]


def check_rendering() -> list[Finding]:
    """One sphere off screen, in a process that may crash."""
    found, ended = tried("rendering")
    remedy = "apt-get install libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri, or what your system calls Mesa's EGL"
    if "middle" not in found:
        return [Finding("rendering", FAILS, f"off screen: {ended or 'no picture'}", remedy)]
    if found["middle"] == found["corner"]:
        return [Finding("rendering", FAILS, "off screen: the picture is empty", remedy)]
    return [Finding("rendering", GOOD, f"a sphere off screen in {found['seconds']:.1f} s")]


def check_threads(environment: Mapping[str, str] = os.environ, cores: int | None = None) -> list[Finding]:
    """Cores of this process, and the variables that numerical libraries read."""
    from strainsight.parallel import cores as usable

    there = cores or usable()
    findings = [Finding("cores", GOOD, f"{there} for this process")]
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        given = environment.get(name)
        if given is None:
            continue
        head = given.split(",")[0].strip()
        if not head.isdigit() or int(head) < 1:
            finding = Finding(
                name, WARNING, f"'{given}' is not a number of threads", f"unset {name}, or give 1 to {there}"
            )
        elif int(head) > there:
            finding = Finding(name, WARNING, f"{head} threads on {there} cores", f"unset {name}, or give 1 to {there}")
        elif int(head) < there:
            finding = Finding(name, GOOD, f"{head} of {there} cores: right where several runs go on at a time")
        else:
            finding = Finding(name, GOOD, f"{head} of {there} cores")
        findings.append(finding)
    return findings


def check_memory() -> list[Finding]:
    """Memory that can still be taken, and the largest model that fits into it."""
    from strainsight.memory import available_memory

    there = available_memory() / GIB
    if math.isinf(there):
        return [Finding("memory", WARNING, "this system does not say how much there is", "watch it on large models")]
    text = f"{there:.1f} GiB available: models up to about {_rounded(largest_model(there))} unknowns"
    if there < LEAST_MEMORY:
        return [Finding("memory", FAILS, text, f"end other programs: the smallest example takes {LEAST_MEMORY} GiB")]
    if there < SOME_MEMORY:
        return [Finding("memory", WARNING, text, "end other programs, or take coarse meshes and --set jobs=1")]
    return [Finding("memory", GOOD, text)]


def largest_model(gib: float) -> float:
    """Unknowns whose import, matrices, factor and modes fit into that memory [GiB]: between what was measured by powers,
    beyond it by the power of the last two, and by the first one's share below."""
    if gib <= PEAKS[0][1]:
        return PEAKS[0][0] * gib / PEAKS[0][1]
    above = next((i for i, (_, peak) in enumerate(PEAKS) if peak >= gib), len(PEAKS) - 1)
    (n, p), (m, q) = PEAKS[above - 1], PEAKS[above]
    return n * math.exp(math.log(gib / p) * math.log(m / n) / math.log(q / p))


def _rounded(unknowns: float) -> str:
    digits = 1 - math.floor(math.log10(max(unknowns, 1.0)))
    return f"{round(unknowns, digits):,.0f}".replace(",", " ")


def check_disk(results: Path) -> list[Finding]:
    """Free disk of the results folder, or of where it would be made, and whether it can be written."""
    folder = next(path for path in (results.absolute(), *results.absolute().parents) if path.exists())
    other = "give another folder with --results DIR"
    if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        what = "cannot be written" if folder.is_dir() else "is a file"
        return [Finding("disk", FAILS, f"{folder if folder != results.absolute() else results} {what}", other)]
    free = shutil.disk_usage(folder).free / GIB
    text = f"{free:.1f} GiB free for {results}"
    if free < LEAST_DISK:
        return [Finding("disk", FAILS, text, f"free some, or {other}")]
    return [
        Finding("disk", WARNING, text, f"free some, or {other}") if free < SOME_DISK else Finding("disk", GOOD, text)
    ]


def check_terminal(environment: Mapping[str, str] = os.environ) -> list[Finding]:
    """Whether the symbols of the tables can be written, and how it is written."""
    encoding = getattr(sys.stdout, "encoding", None) or "ascii"
    try:
        SYMBOLS.encode(encoding)
        locale = Finding("locale", GOOD, f"{encoding}: all symbols can be written")
    except (UnicodeEncodeError, LookupError):
        remedy = "export LC_ALL=C.UTF-8, and unset PYTHONIOENCODING"
        locale = Finding("locale", WARNING, f"{encoding} has no Greek and no arrows: they become ?", remedy)
    columns = shutil.get_terminal_size().columns
    kind = environment.get("TERM", "unknown")
    where = f"{kind}, {columns} columns" if sys.stdout.isatty() else "none: plain lines, no progress bar"
    colour = "without colour (NO_COLOR)" if environment.get("NO_COLOR") else ""
    narrow = sys.stdout.isatty() and columns < 80
    text = ", ".join(part for part in (where, colour) if part)
    remedy = "widen it to 80 columns: tables fold" if narrow else ""
    return [locale, Finding("terminal", WARNING if narrow else GOOD, text, remedy)]
