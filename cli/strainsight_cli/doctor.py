"""`strainsight doctor`: packages, solver, rendering, threads, memory, disk and terminal, each with its remedy."""

from __future__ import annotations

import math
import os
import platform
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

from strainsight.errors import UserError, printable
from strainsight.parallel import cores as usable
from strainsight_cli.printing import json_line, say
from strainsight_cli.trials import tried

GOOD, WARNING, FAILS = "good", "warning", "fails"
GIB = 2.0**30
PEAKS = ((9_000, 0.15), (27_972, 0.31), (98_010, 1.03), (314_262, 4.11), (983_250, 17.4))
"""Unknowns → peak memory [GiB] of import, matrices, factor and 20 modes of a compact mesh: docs/measured.md."""
SYMBOLS = "→ ↩ σ µ ₃ ≤ ·"
LEAST_MEMORY, SOME_MEMORY = 0.4, 2.0
"""[GiB] Memory of the smallest example, and of the coarse hub with its simulations."""
LEAST_DISK, SOME_DISK = 0.1, 2.0
"""[GiB] Free disk space."""
ACCURATE = 1e-9


@dataclass(frozen=True)
class DoctorFinding:
    """One check: subject, result, measured value, and remedy for a failure or warning."""

    subject: str
    result: str
    value: str
    remedy: str = ""


def check_solver() -> DoctorFinding:
    """The sparse solver on a small system, in a separate process that may crash."""
    facts, ended = tried("solver")
    install = "pip install --force-reinstall pypardiso mkl (x86-64 only)"
    reinstall = "pip install --force-reinstall numpy scipy pypardiso"
    if "solver" not in facts:
        return DoctorFinding("solver", FAILS, ended or "no result", reinstall)
    solver, size, seconds, error = (facts[key] for key in ("solver", "unknowns", "seconds", "error"))
    text = f"{solver}, {size} degrees of freedom in {seconds:.2f} s, largest error of the solution {error:.1e}"
    if not error < ACCURATE:
        return DoctorFinding("solver", FAILS, f"{text} (limit {ACCURATE:.0e})", reinstall)
    if solver != "PARDISO":
        why = f" ({facts['why']})" if facts.get("why") else ""
        meaning = "the solver is many times slower, and limited to 100 000 degrees of freedom"
        return DoctorFinding("solver", WARNING, f"{text}; PARDISO is not available{why}, so {meaning}", install)
    return DoctorFinding("solver", GOOD, text)


def check_mpi() -> DoctorFinding:
    """Requirements of `solver: slepc`; since other configs do not need it, its absence is no warning."""
    from strainsight.contrib.mpi.session import programs

    try:
        mpi = programs()
    except UserError as error:
        return DoctorFinding("solver: slepc", GOOD, f"not available; needed for very large models only: {error.what}")
    return DoctorFinding("solver: slepc", GOOD, f"{' '.join(mpi.launcher)}, {mpi.python}")


def check_rendering() -> DoctorFinding:
    """Off-screen rendering of a sphere, in a separate process that may crash."""
    facts, ended = tried("rendering")
    remedy = "apt-get install libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri, or the EGL packages of Mesa on your system"
    if "middle" not in facts:
        return DoctorFinding("rendering", FAILS, f"off-screen rendering failed: {ended or 'no picture'}", remedy)
    if facts["middle"] == facts["corner"]:
        return DoctorFinding("rendering", FAILS, "off-screen rendering failed: the picture is empty", remedy)
    return DoctorFinding("rendering", GOOD, f"off-screen rendering in {facts['seconds']:.1f} s")


def check_threads(environment: Mapping[str, str] = os.environ, cores: int | None = None) -> list[DoctorFinding]:
    """Cores of this process, and the environment variables of numerical libraries."""
    available = cores or usable()
    findings = [DoctorFinding("cores", GOOD, f"{available} cores available to this process")]
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        if (value := environment.get(name)) is None:
            continue
        threads, remedy = value.split(",")[0].strip(), f"unset {name}, or set a value from 1 to {available}"
        if not threads.isdigit() or int(threads) < 1:
            findings.append(DoctorFinding(name, WARNING, f"'{value}' is not a positive number of threads", remedy))
        elif int(threads) > available:
            findings.append(
                DoctorFinding(
                    name,
                    WARNING,
                    f"numerical libraries start {threads} threads, but only {available} cores are available",
                    remedy,
                )
            )
        else:
            several = ": suitable for several parallel runs" * (int(threads) < available)
            findings.append(DoctorFinding(name, GOOD, f"{threads} of {available} cores{several}"))
    return findings


def check_memory() -> DoctorFinding:
    """Available memory, and the largest model that fits into it."""
    from strainsight.memory import available_memory

    available = available_memory() / GIB
    if math.isinf(available):
        return DoctorFinding(
            "memory",
            WARNING,
            "available memory is unknown on this system",
            "monitor the memory use when you compute large models",
        )
    unknowns = largest_model(available)
    rounded = round(unknowns, 1 - math.floor(math.log10(max(unknowns, 1.0))))
    text = f"{available:.1f} GiB available: models up to about {rounded:,.0f} degrees of freedom".replace(",", " ")
    if available < LEAST_MEMORY:
        remedy = f"end other programs; the smallest example needs {LEAST_MEMORY} GiB"
        return DoctorFinding("memory", FAILS, text, remedy)
    if available < SOME_MEMORY:
        return DoctorFinding("memory", WARNING, text, "end other programs, or use coarse meshes and --jobs 1")
    return DoctorFinding("memory", GOOD, text)


def largest_model(gib: float) -> float:
    """Unknowns of the largest model for this memory [GiB], by power-law interpolation and extrapolation of the measurements."""
    if gib <= PEAKS[0][1]:
        return PEAKS[0][0] * gib / PEAKS[0][1]
    above = next((i for i, (_, peak) in enumerate(PEAKS) if peak >= gib), len(PEAKS) - 1)
    (n, p), (m, q) = PEAKS[above - 1], PEAKS[above]
    return n * math.exp(math.log(gib / p) * math.log(m / n) / math.log(q / p))


def check_disk(results: Path) -> DoctorFinding:
    """Free disk space of the results folder, or of its parent, and whether it is writable."""
    folder = next(path for path in (results.absolute(), *results.absolute().parents) if path.exists())
    other = "use another folder with --results DIR"
    if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        what = "is not writable" if folder.is_dir() else "is a file"
        return DoctorFinding("disk", FAILS, f"{folder if folder != results.absolute() else results} {what}", other)
    free = shutil.disk_usage(folder).free / GIB
    text = f"{free:.1f} GiB free for {results}"
    if free >= SOME_DISK:
        return DoctorFinding("disk", GOOD, text)
    return DoctorFinding("disk", FAILS if free < LEAST_DISK else WARNING, text, f"free some disk space, or {other}")


def check_terminal(environment: Mapping[str, str] = os.environ) -> list[DoctorFinding]:
    """Whether the terminal can print the symbols of the tables, and its width."""
    encoding = getattr(sys.stdout, "encoding", None) or "ascii"
    try:
        SYMBOLS.encode(encoding)
        locale = DoctorFinding("locale", GOOD, f"{encoding}: all symbols can be printed")
    except (UnicodeEncodeError, LookupError):
        remedy = "export LC_ALL=C.UTF-8, and unset PYTHONIOENCODING"
        locale = DoctorFinding(
            "locale", WARNING, f"{encoding} has no Greek letters and no arrows; they are printed as ?", remedy
        )
    columns = shutil.get_terminal_size().columns
    kind = environment.get("TERM", "unknown")
    where = f"{kind}, {columns} columns" if sys.stdout.isatty() else "not a terminal: plain lines, no progress bar"
    colour = "without colour (NO_COLOR)" if environment.get("NO_COLOR") else ""
    narrow = sys.stdout.isatty() and columns < 80
    text = ", ".join(part for part in (where, colour) if part)
    remedy = "widen the terminal to 80 columns, to avoid line breaks in tables" if narrow else ""
    return [locale, DoctorFinding("terminal", WARNING if narrow else GOOD, text, remedy)]


MODULES = {"ruamel.yaml": "ruamel.yaml", "ruamel-yaml": "ruamel.yaml"}
"""Package → module, if the names differ."""
CAN_DO_WITHOUT = ("pypardiso",)
"""The row `solver` reports the effect."""


def check_packages() -> list[DoctorFinding]:
    """Version of Python and of every package, and whether each can be imported, in a separate process that may crash."""
    python, requirements = asked_for()
    findings = compared(python, requirements)
    present = [finding.subject for finding in findings if finding.result == GOOD and finding.subject != "python"]
    facts, ended = tried("imports", [MODULES.get(name, name) for name in present])
    broken: dict[str, str] = dict(facts.get("failed", {}))
    if ended:
        broken[facts.get("at", "")] = ended
    return [
        DoctorFinding(
            entry.subject,
            FAILS,
            f"{entry.value}; import failed: {why}",
            f"pip install --force-reinstall {entry.subject}",
        )
        if (why := broken.get(MODULES.get(entry.subject, entry.subject)))
        else entry
        for entry in findings
    ]


def asked_for() -> tuple[str, list[str]]:
    """(range of Python, requirements): of the pyproject.toml of the checkout, or as installed.

    The metadata of an installed checkout may be older than its pyproject.toml."""
    import tomllib

    import strainsight

    file = Path(strainsight.__file__).parents[2] / "pyproject.toml"
    if file.is_file():
        project = tomllib.loads(file.read_text(encoding="utf-8")).get("project", {})
        if project.get("name") == "strainsight":
            return project["requires-python"], list(project["dependencies"])
    noted = metadata.metadata("strainsight")
    requirements = [line for line in noted.get_all("Requires-Dist") or [] if "extra ==" not in line]
    return (noted.get_all("Requires-Python") or [""])[0], requirements


def compared(python: str, requirements: Sequence[str]) -> list[DoctorFinding]:
    """Every version and its permitted range; requirements of other platforms are omitted."""
    try:
        from packaging.requirements import Requirement
        from packaging.specifiers import SpecifierSet
    except ImportError:
        return [
            DoctorFinding("packaging", FAILS, "not installed; versions cannot be compared", "pip install packaging")
        ]
    running = platform.python_version()
    within = SpecifierSet(python).contains(running, prereleases=True)
    remedy = f"install strainsight with Python {python}; in the repository: make PYTHON=/path/to/python"
    findings = [_version_finding("python", running, python, within, remedy)]
    for line in requirements:
        requirement = Requirement(line)
        if requirement.marker is not None and not requirement.marker.evaluate():
            continue
        wanted = str(requirement.specifier)
        remedy = f"pip install '{requirement.name}{wanted}'"
        try:
            version = metadata.version(requirement.name)
        except metadata.PackageNotFoundError:
            result, need = (WARNING, "recommended") if requirement.name in CAN_DO_WITHOUT else (FAILS, "required")
            findings.append(DoctorFinding(requirement.name, result, f"not installed; {need} version: {wanted}", remedy))
            continue
        within = requirement.specifier.contains(version, prereleases=True)
        findings.append(_version_finding(requirement.name, version, wanted, within, remedy))
    return findings


def _version_finding(subject: str, version: str, wanted: str, within: bool, remedy: str) -> DoctorFinding:
    if within:
        return DoctorFinding(subject, GOOD, f"{version} ({wanted})")
    return DoctorFinding(subject, FAILS, f"{version} is installed, but {wanted} is required", remedy)


COLOURS = {GOOD: "green", WARNING: "yellow", FAILS: "red"}


def examine(results: Path) -> list[DoctorFinding]:
    """All checks, in the order of the table."""
    return [
        *check_packages(),
        check_solver(),
        check_mpi(),
        check_rendering(),
        *check_threads(),
        check_memory(),
        check_disk(results),
        *check_terminal(),
    ]


def show(findings: Sequence[DoctorFinding], as_json: bool) -> int:
    """Print the table, with remedies below the rows, or one JSON object per check; the exit code: 1 if a check fails."""
    counts = {result: sum(finding.result == result for finding in findings) for result in COLOURS}
    if as_json:
        say(*(json_line(asdict(finding)) for finding in findings))
        return int(counts[FAILS] > 0)
    from rich.text import Text

    from strainsight_cli.render import print_grid

    rows = []
    for finding in findings:
        text = printable(finding.value) + (f"\n→ {printable(finding.remedy)}" if finding.remedy else "")
        result = Text(finding.result, style=COLOURS[finding.result])
        rows.append((Text(finding.subject), result, Text(text)))
    print_grid(("check", "result", "value"), rows)
    many = "" if counts[WARNING] == 1 else "s"
    say("", f"{counts[FAILS]} of {len(findings)} checks failed, {counts[WARNING]} warning{many}")
    return int(counts[FAILS] > 0)
