"""Check the licence of every package that is there at run time, and that docs/dependencies.md names it; --table prints it.

Reads pyproject.toml and the metadata of what is installed. A licence that is not known here fails, GPL and AGPL with it, and LGPL
where it is not judged by name.
"""

import re
import sys
import tomllib
from importlib.metadata import Distribution, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

# Extras of use beyond development. `meshes` is none: gmsh (GPL) writes the meshes of this repository and is never imported.
EXTRAS = ("dask", "daq", "results")
DOCS = Path("docs/dependencies.md")
# What a package may say: SPDX expressions without their operators, classifiers, or one line.
FREE = {
    *["0BSD", "BSD", "BSD-2-Clause", "BSD-3-Clause", "BSD License", "ISC", "ISC License", "ISC License (ISCL)"],
    *["MIT", "MIT-CMU", "MIT License", "Zlib", "CC0-1.0", "PSF-2.0", "Python Software Foundation License"],
    *["Apache-2.0", "LLVM-exception", "Apache-2.0 with LLVM exceptions", "Apache Software License", "Apache 2.0"],
    *["MPL-2.0", "Mozilla Public License 2.0 (MPL 2.0)"],
}
# Free of charge and to be passed on, but not free software: what MKL's PARDISO brings.
INTEL = {"Intel Simplified Software License", "Intel End User License Agreement for Developer Tools"}
# LGPL, each judged in docs/dependencies.md: package → the words it was judged under. Of an extra only.
JUDGED = {"asammdf": "LGPLv3+", "nptdms": "LGPL-3.0-only"}
OPERATORS = re.compile(r"\s+(?:AND|OR|WITH)\s+|[()]")


def at_run_time(extras: tuple[str, ...] = EXTRAS) -> dict[str, Distribution]:
    """The packages that an installation of strainsight has, from Requires-Dist and its markers."""
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
    asked = [*project["dependencies"], *(line for e in extras for line in project["optional-dependencies"].get(e, []))]
    found, seen = {}, set()
    while asked:
        wanted = Requirement(asked.pop())
        name = canonicalize_name(wanted.name)
        own = ("", *sorted(wanted.extras))
        if (name, own) in seen or (wanted.marker and not wanted.marker.evaluate({"extra": ""})):
            continue
        seen.add((name, own))
        found[name] = distribution(name)
        for line in found[name].requires or []:
            marker = Requirement(line).marker
            if marker is None or any(marker.evaluate({"extra": extra}) for extra in own):
                # settled here: its extra is that of the package which asks
                asked.append(line.partition(";")[0])
    return dict(sorted(found.items()))


def licence(package: Distribution) -> str | None:
    """What it says, as one line; None where that is not known here."""
    said = package.metadata.get("License-Expression")
    judged = JUDGED.get(canonicalize_name(package.metadata["Name"]))
    if judged is not None and judged in (said, (package.metadata.get("License") or "").strip()):
        return judged
    if said:
        return said if all(part in FREE for part in OPERATORS.split(said) if part) else None
    line = (package.metadata.get("License") or "").strip()
    classifiers = [c.split(" :: ") for c in package.metadata.get_all("Classifier", [])]
    named = [
        c[-1] for c in classifiers if c[0] == "License" and c[-1] not in ("Other/Proprietary License", "OSI Approved")
    ]
    # a licence in full is no name of one
    lines = [line] if line and "\n" not in line and len(line) < 80 else []
    return (lines or named)[0] if named + lines and all(map(_is_known, named + lines)) else None


def _is_known(said: str) -> bool:
    """One licence by its name, or several free ones as an expression."""
    return said in FREE | INTEL or all(part in FREE for part in OPERATORS.split(said) if part)


if __name__ == "__main__":
    packages = at_run_time()
    licences = {name: licence(package) for name, package in packages.items()}
    rows = {name: f"| {name} | {said} |" for name, said in licences.items()}
    if "--table" in sys.argv:
        print("\n".join(rows.values()))
        sys.exit()
    documented = DOCS.read_text(encoding="utf-8").splitlines()
    wrong = [
        f"{name}: its licence is not known; judge it in .ci/licences.py" for name, said in licences.items() if not said
    ]
    plainly = at_run_time(())
    wrong += [f"{name}: {licences[name]} is judged for an extra, and it comes with all" for name in JUDGED if name in plainly]
    wrong += [f"{name}: {DOCS} lacks '{row}'" for name, row in rows.items() if licences[name] and row not in documented]
    if wrong:
        sys.exit("\n".join(["licences:", *wrong]))
    print(f"licences: {len(packages)} packages at run time, all known")
