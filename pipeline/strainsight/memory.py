"""How much memory there is, before it runs out."""

from __future__ import annotations

import math
from pathlib import Path

from strainsight.errors import UserError

GIB = 1024.0**3
PROC, CGROUP = Path("/proc"), Path("/sys/fs/cgroup")


SMALLER = "use a coarser mesh or a machine with more memory, or close other programs"


def require_memory(needed: float, what: str, remedy: str = SMALLER) -> None:
    """Raise UserError where a step takes more than is available; needed [bytes]; what as in "the factor of 10 degrees of
    freedom"."""
    available = available_memory()
    if needed > available:
        raise UserError(
            f"{what}: {needed / GIB:.3g} GiB of memory are needed, but {available / GIB:.3g} GiB are available",
            remedy=remedy,
        )


def available_memory() -> float:
    """[bytes] this process can still take: the least of what the machine has free, what the limits of its control
    groups leave, and what its limit of address space leaves. Infinite where the system does not say (not Linux)."""
    free = 1024 * _named(PROC / "meminfo", "MemAvailable:", math.inf)
    return max(0.0, min(free, _control_groups(), _address_space()))


def _control_groups() -> float:
    """Every group above the process may have a limit; the file cache in a group's usage is given back when needed."""
    least = math.inf
    for line in _lines(PROC / "self" / "cgroup"):
        _, controllers, path = line.split(":", 2)
        if not controllers:
            root, limit, usage, cache = CGROUP, "memory.max", "memory.current", "inactive_file"
        elif "memory" in controllers.split(","):
            root, cache = CGROUP / "memory", "total_inactive_file"
            limit, usage = "memory.limit_in_bytes", "memory.usage_in_bytes"
        else:
            continue
        group = root / path.lstrip("/")
        # inside a container the path is the host's and may not be there: the root is then the container's own group
        for folder in (group, *group.parents):
            if folder.is_relative_to(root):
                cached = _named(folder / "memory.stat", cache, 0.0)
                least = min(least, _number(folder / limit) - _number(folder / usage, 0.0) + cached)
    return least


def _named(file: Path, name: str, otherwise: float) -> float:
    """The number behind this word in a file; `otherwise` where it has none."""
    numbers = dict(words[:2] for line in _lines(file) if len(words := line.split()) > 1)
    return float(numbers.get(name, otherwise))


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
