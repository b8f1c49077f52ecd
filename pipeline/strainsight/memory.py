"""How much memory there is, before it runs out."""

from __future__ import annotations

import math
from pathlib import Path

from strainsight.errors import UserError

GIB = 1024.0**3
PROC, CGROUP = Path("/proc"), Path("/sys/fs/cgroup")


SMALLER = "take a coarser mesh or a larger machine, or end other programs"


def require_memory(needed: float, what: str, remedy: str = SMALLER) -> None:
    """Raise UserError where a step takes more than is available; needed [bytes]; what as in "the factor of 10 unknowns"."""
    there = available_memory()
    if needed > there:
        raise UserError(
            f"{what}: {needed / GIB:.3g} GiB of memory are needed, {there / GIB:.3g} GiB are available",
            remedy=remedy,
        )


def available_memory() -> float:
    """[bytes] this process can still take: the least of what the machine has free, what the limits of its control
    groups leave, and what its limit of address space leaves. Infinite where the system does not say (not Linux)."""
    return max(0.0, min(_machine(), _control_groups(), _address_space()))


def _machine() -> float:
    for line in _lines(PROC / "meminfo"):
        if line.startswith("MemAvailable:"):
            return float(line.split()[1]) * 1024
    return math.inf


def _control_groups() -> float:
    """Every group above the process may have a limit; the file cache in a group's usage is given back when needed."""
    least = math.inf
    for line in _lines(PROC / "self" / "cgroup"):
        _, controllers, path = line.split(":", 2)
        if not controllers:
            root, limit, usage, cache = CGROUP, "memory.max", "memory.current", "inactive_file"
        elif "memory" in controllers.split(","):
            root, limit, usage, cache = (
                CGROUP / "memory",
                "memory.limit_in_bytes",
                "memory.usage_in_bytes",
                "total_inactive_file",
            )
        else:
            continue
        group = root / path.lstrip("/")
        # inside a container the path is the host's and may not be there: the root is then the container's own group
        for folder in (group, *group.parents):
            if folder.is_relative_to(root):
                least = min(least, _number(folder / limit) - _number(folder / usage, 0.0) + _cached(folder, cache))
    return least


def _cached(folder: Path, name: str) -> float:
    for line in _lines(folder / "memory.stat"):
        if line.startswith(f"{name} "):
            return float(line.split()[1])
    return 0.0


def _address_space() -> float:
    try:
        import resource
    except ImportError:  # Windows
        return math.inf
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    pages = _lines(PROC / "self" / "statm")
    if limit == resource.RLIM_INFINITY or not pages:
        return math.inf
    return float(limit) - float(pages[0].split()[0]) * resource.getpagesize()


def _number(file: Path, otherwise: float = math.inf) -> float:
    """The number in a file of one line; `otherwise` where there is no file or it says max."""
    lines = _lines(file)
    return float(lines[0]) if lines and lines[0].strip().isdigit() else otherwise


def _lines(file: Path) -> list[str]:
    try:
        return file.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return []
