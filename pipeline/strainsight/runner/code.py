"""Which code a stage is made of: the modules that its function reaches by imports or names, what they name beside them, and their
digest."""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import strainsight

PACKAGE = "strainsight"
_IMPORT = re.compile(
    rb"^[ \t]*from[ \t]+(strainsight[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|^[ \t]*import[ \t]+(strainsight[\w.]*)",
    re.M,
)
_NAME = re.compile(rb"\w+")
_NAMED = re.compile(rb"[\"'](strainsight(?:\.\w+)+)[\"']")
"""A module that is loaded by its name, here or in a process of its own."""
_PART = re.compile(rb"[\"']((?:\w+/)*\w+\.(?:css|js))[\"']")
"""Styles and scripts of a page."""
ROOT = Path(strainsight.__file__).parent


def code_of(run: Callable[..., object]) -> str:
    """Sixteen digits of sha256 over the source of the module of a stage's function and of all modules of the package that it
    imports or names, directly or not, wherever that stands, and of styles and scripts that these name. Of other packages the
    lock has the versions."""
    return digest_of(closure(run.__module__))


def digest_of(modules: frozenset[str]) -> str:
    """Of the names and sources of modules."""
    sha = hashlib.sha256()
    for name in sorted(modules):
        sha.update(name.encode() + b"\0" + _digest(name))
    return sha.hexdigest()[:16]


@cache
def closure(module: str) -> frozenset[str]:
    """Names of the modules that one reaches, itself among them, and of styles and scripts, by their path in the package."""
    found, open_ = {module}, [module]
    while open_:
        for name in _imports(open_.pop()) - found:
            found.add(name)
            open_.append(name)
    return frozenset(found)


@cache
def _imports(module: str) -> frozenset[str]:
    found = set()
    for package, names, plain in _IMPORT.findall(_source(module)):
        base = (package or plain).decode()
        found.add(base)
        found |= {f"{base}.{name.decode()}" for name in _NAME.findall(names)}
    found |= {name.decode() for name in _NAMED.findall(_source(module))}
    found |= {part for name in _PART.findall(_source(module)) if (part := _part(module, name.decode()))}
    return frozenset(name for name in found if _file(name) is not None)


@cache
def _source(module: str) -> bytes:
    file = _file(module)
    return b"" if file is None else file.read_bytes()


@cache
def _digest(module: str) -> bytes:
    return hashlib.sha256(_source(module)).digest()


def _part(module: str, name: str) -> str:
    """The path in the package of a file that a module names from its own folder or one above; "" where there is none."""
    file = _file(module)
    for folder in file.parents if file is not None and file.is_relative_to(ROOT) else ():
        if (folder / name).is_file():
            return (folder / name).relative_to(ROOT).as_posix()
        if folder == ROOT:
            break
    return ""


def _file(module: str) -> Path | None:
    """The file of a module, or of a part of the package by its path; None where there is none."""
    if "/" in module:
        return ROOT / module
    if module != PACKAGE and not module.startswith(f"{PACKAGE}."):
        own = getattr(sys.modules.get(module), "__file__", None)
        return Path(own) if own else None
    path = ROOT.joinpath(*module.split(".")[1:])
    return next((file for file in (path / "__init__.py", path.with_suffix(".py")) if file.is_file()), None)
