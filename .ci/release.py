"""Build wheel and sdist into dist/, check both in an empty environment, and print the steps that are left to do by hand.

The wheel is installed with its dependencies into build/release and runs the cantilever in an empty folder. A wheel built from
the sdist must have the same files. Nothing is tagged or uploaded.
"""

import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"
ENVIRONMENT = ROOT / "build" / "release"
SHORT = ("--set", "place.instants=1", "--set", "validate.repeats=1", "--set", "validate.random_sets=0")


def run(*command, cwd=ROOT):
    """The output of a command. Ends the program with that output if the command fails."""
    print("+", *(Path(word).name if Path(str(word)).is_absolute() else word for word in command), flush=True)
    done = subprocess.run([*map(str, command)], cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode:
        sys.exit(f"{done.stdout}\nthe command ended with {done.returncode}")
    return done.stdout


def check_tree(version):
    """Refuse a version without a section in the changelog, and uncommitted changes."""
    heading = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    if heading is None or heading[1] != version:
        sys.exit(f"CHANGELOG.md does not begin with version {version} of pyproject.toml. Add a section '## {version}'.")
    if changes := run("git", "status", "--porcelain"):
        sys.exit(f"uncommitted changes:\n{changes}Commit or remove them.")


def files_of(wheel):
    return sorted(zipfile.ZipFile(wheel).namelist())


def build(folder, source=ROOT):
    """(wheel, sdist) of a source folder."""
    run(sys.executable, "-m", "hatchling", "build", "--directory", folder, cwd=source)
    return next(folder.glob("*.whl")), next(folder.glob("*.tar.gz"))


def check_sdist(wheel, sdist):
    """A wheel built from the sdist has the files of the wheel."""
    with tempfile.TemporaryDirectory() as name:
        with tarfile.open(sdist) as archive:
            archive.extractall(name, filter="data")
        rebuilt, _ = build(Path(name) / "dist", next(Path(name).iterdir()))
        if files_of(rebuilt) != files_of(wheel):
            difference = sorted({*files_of(rebuilt)} ^ {*files_of(wheel)})
            sys.exit("wheel and sdist differ:\n" + "\n".join(difference))


def check_wheel(wheel, version):
    """The wheel installs into an empty environment and runs an example in an empty folder."""
    venv.create(ENVIRONMENT, with_pip=True, clear=True)
    binaries = next(path.parent for path in ENVIRONMENT.glob("*/python*") if path.stem == "python")
    run(binaries / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel)
    run(binaries / "python", "-m", "pip", "check", "--disable-pip-version-check")
    with tempfile.TemporaryDirectory() as folder:
        if version not in (printed := run(binaries / "strainsight", "--version", cwd=folder)):
            sys.exit(f"the installed version is {printed}")
        run(binaries / "strainsight", "example", "cantilever", cwd=folder)
        print(run(binaries / "strainsight", "run", "cantilever.yaml", *SHORT, cwd=folder))
        if not list(Path(folder).glob("results/*/report.html")):
            sys.exit("the run wrote no report.html")


def main():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    check_tree(version)
    shutil.rmtree(DIST, ignore_errors=True)
    wheel, sdist = build(DIST)
    check_sdist(wheel, sdist)
    check_wheel(wheel, version)
    for path in (wheel, sdist):
        print(f"{path.relative_to(ROOT)}  {path.stat().st_size / 1e6:.1f} MB")
    print(
        f"Left to do by hand:\n"
        f"  1. Replace 'unreleased' by the date in CHANGELOG.md, and set the date in CITATION.cff; commit.\n"
        f"  2. Store the results files of this release: python -m tests.runner.release --replace; commit.\n"
        f"  3. Repeat make release on that commit.\n"
        f"  4. git tag -s v{version} && git push origin v{version}\n"
        f"  5. twine upload dist/*\n"
        f"  6. Raise the version in pyproject.toml and pipeline/strainsight/__init__.py, and open its section in CHANGELOG.md."
    )


if __name__ == "__main__":
    main()
