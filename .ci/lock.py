"""Print what pip resolves the dependencies and [dev] of pyproject.toml to.

Without an option: the newest, requirements-dev.lock. --lowest: every dependency at the lower end of its range, with the
newest of what they ask for, .ci/lowest.lock. --keep FILE: the versions of that lock, with the hashes that are there now.

Every package has the sha256 of all its files, so that pip installs nothing else under that name and version; uv asks for them.
"""

import json
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

# What only pypardiso brings: not there on machines without Intel's MKL.
INTEL = {"pypardiso", "mkl", "intel-openmp", "intel-cmplr-lib-ur", "tbb", "tcmlib", "umf"}
UV = "uv==0.13.9"
"""What writes the hashes, of one version, so that a lock changes with its packages alone."""
MARKER = "; platform_machine == 'x86_64' or platform_machine == 'AMD64'"
HEADS = {
    False: "# What `make` installs: pyproject.toml's dependencies with [dev], resolved for Python 3.11. Renew: make lock",
    True: "# What `make lowest` installs: the lower ends of pyproject.toml's dependencies, Python 3.11. Renew: make lock",
}


def resolved(lowest):
    """name==version of all that pip would install."""
    with open("pyproject.toml", "rb") as file:
        project = tomllib.load(file)["project"]
    extras = project["optional-dependencies"]
    used = project["dependencies"] + extras["dask"] + extras["daq"] + extras["results"]
    wanted = [line.replace(">=", "==") if lowest else line for line in used] + extras["dev"]
    resolve = ["install", "--quiet", "--dry-run", "--ignore-installed", "--report", "-", *wanted]
    report = json.loads(subprocess.run([sys.executable, "-m", "pip", *resolve], check=True, capture_output=True).stdout)
    packages = (entry["metadata"] for entry in report["install"])
    return sorted(f"{package['name'].lower().replace('_', '-')}=={package['version']}" for package in packages)


def kept(lock):
    """name==version of a lock."""
    lines = lock.read_text(encoding="utf-8").splitlines()
    return [line.split(";")[0].strip(" \\") for line in lines if not line.startswith(("#", " "))]


def hashed(pins):
    """The lines of a lock: every pin with its marker and the hashes of its files."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "pins.txt").write_text("\n".join(pins) + "\n", encoding="utf-8")
        venv.create(folder / "venv", with_pip=True)
        python = next(path for path in (folder / "venv").glob("*/python*") if path.stem == "python")
        subprocess.run([python, "-m", "pip", "install", "--quiet", UV], check=True, stdout=sys.stderr)
        ask = "-m uv pip compile pins.txt --no-deps --no-header --no-annotate --generate-hashes --python-version 3.11.9 --quiet"
        done = subprocess.run([python, *ask.split()], check=True, stdout=subprocess.PIPE, text=True, cwd=folder)
    lines = []  # uv leaves out what this machine does not need to be told
    for line in done.stdout.splitlines():
        name = line.split("==")[0]
        lines.append(line.replace(" \\", f" {MARKER} \\", 1) if name in INTEL else line)
    return lines


lowest = "--lowest" in sys.argv
pins = kept(Path(sys.argv[sys.argv.index("--keep") + 1])) if "--keep" in sys.argv else resolved(lowest)
print(HEADS[lowest])
print("\n".join(hashed(pins)))
