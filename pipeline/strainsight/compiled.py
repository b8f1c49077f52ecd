"""Compiled code that is kept on disk, notices a change of every file that it is made of, and is compiled by one process."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from strainsight.file_lock import lock_file
from strainsight.imports import in_package_folder

with in_package_folder():
    from numba import carray, cfunc, float64, int64, njit, types
    from numba.core import config
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import Compiler
    from numba.core.compiler_lock import global_compiler_lock
    from numba.extending import intrinsic

config._config_fname = os.devnull  # type: ignore[attr-defined]  # numba reads it again whenever it compiles

__all__ = [
    "carray",
    "cfunc",
    "float64",
    "inner",
    "int64",
    "intrinsic",
    "joined",
    "kept",
    "njit",
    "track_dependencies",
    "types",
]
"""The only module that imports numba, whose settings in the working folder would move its cache, which holds pickles."""

F = TypeVar("F", bound=Callable[..., Any])


def kept(*files: str, **options: Any) -> Callable[[F], F]:
    """`njit(cache=True)` of a function that is made of these other files of the package, too: of compiled code that it calls
    (`inner`), and of what its tuples are; what is divided by zero is not finite, which its caller looks for."""

    def compiled(function: F) -> F:
        compiled: F = _compiled_once(
            track_dependencies(njit(cache=True, error_model="numpy", **options)(function), files)
        )
        return compiled

    return compiled


def _compiled_once(function: Any) -> Any:
    """Other processes wait while one compiles a signature, and load it from the disk."""
    index: Any = getattr(getattr(function, "_cache", None), "_cache_file", None)
    if hasattr(index, "_index_path"):
        compile_signature = function.compile

        def compile_or_load(signature: Any) -> Any:
            os.makedirs(index._cache_path, exist_ok=True)
            with global_compiler_lock, open(f"{index._index_path}.lock", "ab") as lock:
                with suppress(OSError):  # a disk without locks
                    lock_file(lock.fileno(), wait=True)
                return compile_signature(signature)

        function.compile = compile_or_load
    return function


class _Part(JITCodeLibrary):  # type: ignore[misc]
    """Code that is optimised, and made machine code, only as part of what calls it; numba by itself does both at every level."""

    def _optimize_final_module(self) -> None: ...

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> _Part:
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing: no Python is called from it."""


class _InnerCompiler(Compiler):  # type: ignore[misc]
    def __init__(self, typing: Any, target: Any, library: Any, *rest: Any) -> None:
        super().__init__(typing, target, library or _Part(target.codegen(), "part"), *rest)


def inner(function: F, **options: Any) -> F:
    """Compile a function that only compiled code calls, as part of its caller: a Python wrapper and a separate cache file would
    double the compile time. A call from Python ends the process."""
    settings: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": _InnerCompiler, **options}
    compiled: F = njit(error_model="numpy", **settings)(function)
    return compiled


def joined(function: F) -> F:
    """`inner` that becomes part of its caller: one that is called once, with arrays that the caller makes, which then are known
    to overlap no other."""
    return inner(function, forceinline=True)


def track_dependencies(function: Any, files: tuple[str, ...]) -> Any:
    """numba by itself looks at the time and the size of a function's own file alone."""
    folder, file_name = Path(__file__).parent, Path(__file__).name
    index: Any = getattr(getattr(function, "_cache", None), "_cache_file", None)
    if hasattr(index, "_source_stamp"):
        times = tuple((at.st_mtime, at.st_size) for at in ((folder / file).stat() for file in (file_name, *files)))
        index._source_stamp = (index._source_stamp, *times)
        index._load_index = partial(_readable, index._load_index)
    return function


def _readable(load: Callable[[], dict[Any, str]]) -> dict[Any, str]:
    """What is kept, nothing where it is of classes that are elsewhere now: the index is read before its stamp is looked at."""
    try:
        return load()
    except (AttributeError, ImportError):
        return {}
