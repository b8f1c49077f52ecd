"""Print what pip resolves the dependencies and [dev] of pyproject.toml to.

Without an option: the newest, requirements-dev.lock. --lowest: every dependency at the lower end of its range, with the
newest of what they ask for, .ci/lowest.lock.
"""

import json
import subprocess
import sys
import tomllib

# What only pypardiso brings: not there on machines without Intel's MKL.
INTEL = {"pypardiso", "mkl", "intel-openmp", "intel-cmplr-lib-ur", "tbb", "tcmlib", "umf"}
MARKER = "; platform_machine == 'x86_64' or platform_machine == 'AMD64'"
HEADS = {
    False: "# What `make` installs: pyproject.toml's dependencies with [dev], resolved for Python 3.11. Renew: make lock",
    True: "# What `make lowest` installs: the lower ends of pyproject.toml's dependencies, Python 3.11. Renew: make lock",
}

with open("pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
lowest = "--lowest" in sys.argv
extras = project["optional-dependencies"]
used = project["dependencies"] + extras["dask"] + extras["daq"] + extras["results"]
wanted = [line.replace(">=", "==") if lowest else line for line in used] + extras["dev"]
resolve = ["install", "--quiet", "--dry-run", "--ignore-installed", "--report", "-", *wanted]
report = json.loads(subprocess.run([sys.executable, "-m", "pip", *resolve], check=True, capture_output=True).stdout)
packages = (entry["metadata"] for entry in report["install"])
found = sorted((package["name"].lower().replace("_", "-"), package["version"]) for package in packages)
print(HEADS[lowest])
for name, version in found:
    print(f"{name}=={version}{MARKER if name in INTEL else ''}")
