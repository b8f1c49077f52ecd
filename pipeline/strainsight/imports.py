"""Import of libraries that read settings from the working folder: numba (`.numba_config.yaml`), Matplotlib (`matplotlibrc`)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

FOLDER = Path(__file__).parent
"""Of this package: whoever can write there can change its code, too."""


@contextmanager
def in_package_folder() -> Iterator[None]:
    """Make FOLDER the working folder meanwhile: what is imported first reads no settings of a project's folder."""
    try:
        before = os.getcwd()
    except OSError:  # a folder that has been removed holds no settings
        yield
        return
    os.chdir(FOLDER)
    try:
        yield
    finally:
        os.chdir(before)
