"""Check what pip cannot install: Python 3.11 with venv, and the Debian libraries that draw without a display.

Prints the apt-get line for what is missing and exits 1; with --packages prints only the names of the missing packages.
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


def missing():
    packages = []
    if importlib.util.find_spec("ensurepip") is None or importlib.util.find_spec("venv") is None:
        packages.append(f"python{VERSION}-venv")
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
    packages = " ".join(missing())
    if "--packages" in sys.argv:
        print(packages)
    elif packages:
        sys.exit("Debian packages are missing. Install them with:\n    apt-get install " + packages)
