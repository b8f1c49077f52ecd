"""What an artefact was computed with: commit, libraries, processor. No part of its key, nor of its digest."""

from __future__ import annotations

import json
import platform
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path

import h5py
import numpy as np

import strainsight

ROOT = Path(strainsight.__file__).parent
CPU = Path("/proc/cpuinfo")
PACKAGES = ("scipy", "numba", "pypardiso", "mkl")
"""Asked of what is installed, not imported: a stage loads what it needs."""


@cache
def provenance() -> dict[str, str]:
    """Name of an attribute → what it says, "" where it is not known or not there."""
    return {
        "package_version": strainsight.__version__,
        "commit": commit_of(ROOT.parents[1]) or commit_of_build(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "h5py": h5py.__version__,
        **{name: _installed(name) for name in PACKAGES},
        "blas": _blas(),
        "processor": _processor(),
    }


def commit_of(checkout: Path) -> str:
    """Of a git checkout, read without git; "" where there is none. What was altered since shows in the digest of the code."""
    with suppress(OSError, ValueError, IndexError):
        git = checkout / ".git"
        if git.is_file():  # a worktree: "gitdir: …"
            git = (checkout / git.read_text(encoding="utf-8").split(":", 1)[1].strip()).resolve()
        head = (git / "HEAD").read_text(encoding="utf-8").strip()
        if not head.startswith("ref: "):
            return head
        name = head.removeprefix("ref: ")
        common = git / "commondir"
        top = (git / common.read_text(encoding="utf-8").strip()).resolve() if common.is_file() else git
        for folder in (git, top):
            if (folder / name).is_file():
                return (folder / name).read_text(encoding="utf-8").strip()
        for line in (top / "packed-refs").read_text(encoding="utf-8").splitlines():
            if line.endswith(f" {name}"):
                return line.split()[0]
    return ""


def commit_of_build() -> str:
    """Of an installation from a repository, as pip notes it."""
    with suppress(metadata.PackageNotFoundError, ValueError, KeyError, TypeError):
        text = metadata.distribution("strainsight").read_text("direct_url.json")
        return str(json.loads(text or "{}")["vcs_info"]["commit_id"])
    return ""


def _installed(name: str) -> str:
    with suppress(metadata.PackageNotFoundError):
        return metadata.version(name)
    return ""


def _blas() -> str:
    """That of numpy, as in "scipy-openblas 0.3.30"."""
    with suppress(KeyError, TypeError):
        own = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
        return f"{own['name']} {own['version']}"
    return ""


def _processor() -> str:
    with suppress(OSError):
        for line in CPU.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
