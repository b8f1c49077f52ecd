"""Check what pip cannot install: Python 3.11 with venv, and the Debian libraries that draw without a display.

Without venv nothing can be set up: exit code 1, with the apt-get line and a way without root. Without the libraries all is
computed, and pages have no 3D pictures: a note. With --packages prints only the names of the missing packages.
"""

import ctypes
import glob
import importlib.util
import sys

VERSION = f"{sys.version_info[0]}.{sys.version_info[1]}"
LIBRARIES = {"libEGL.so.1": "libegl1", "libGL.so.1": "libgl1", "libEGL_mesa.so.0": "libegl-mesa0"}
DRIVERS = (
    "/usr/lib*/*/dri/swrast_dri.so",
    "/usr/lib*/dri/swrast_dri.so",
    "/usr/lib*/*/libgallium*.so",
    "/usr/lib*/libgallium*.so",
)


def needed():
    """What there is no way on without."""
    there = all(importlib.util.find_spec(name) is not None for name in ("ensurepip", "venv"))
    return [] if there else [f"python{VERSION}-venv"]


def drawing():
    """What pictures are drawn with."""
    packages = []
    if sys.platform.startswith("linux"):
        packages += [package for library, package in LIBRARIES.items() if not loads(library)]
        if not any(glob.glob(pattern) for pattern in DRIVERS):
            packages.append("libgl1-mesa-dri")
    return packages


def loads(library):
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


if __name__ == "__main__":
    if sys.version_info < (3, 11):  # noqa: UP036  this file is what tells an older Python
        sys.exit(f"strainsight needs Python 3.11 or later, this is {VERSION}. Name another: make PYTHON=python3.11")
    if "--packages" in sys.argv:
        print(" ".join(needed() + drawing()))
    elif without := needed():
        sys.exit(
            f"This Python has no venv. Install it:\n    apt-get install {' '.join(without)}\n"
            "or, without root, take a Python that has it, as those of conda, pyenv and uv do:\n"
            "    make PYTHON=/path/to/python3.11"
        )
    elif without := drawing():
        print(
            "note: pages will have no 3D pictures, all else is computed; for them:\n    apt-get install " + " ".join(without),
            file=sys.stderr,
        )
