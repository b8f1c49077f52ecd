"""Ask the database of Python packages whether a known vulnerability is in requirements-dev.lock.

Without a network, or where a mirror of the registry does not answer for its database, it says so and fails nothing.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

LOCK = Path("requirements-dev.lock")


def asked(lines):
    """What pip-audit says of pinned requirements: a list of {name, version, vulns or skip_reason}; empty where it fails."""
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
        file.write("\n".join(lines) + "\n")
        file.flush()
        command = [sys.executable, "-m", "pip_audit", "--requirement", file.name, "--no-deps", "--disable-pip"]
        try:
            done = subprocess.run(
                [*command, "--format", "json", "--progress-spinner", "off"], capture_output=True, text=True, timeout=300
            )
            return json.loads(done.stdout)["dependencies"]
        except (subprocess.TimeoutExpired, ValueError, KeyError):
            return []


lines = LOCK.read_text(encoding="utf-8").splitlines()
pins = [line.removesuffix(" \\") for line in lines if not line.startswith(("#", " "))]  # without their hashes
# one package first: a hundred that nobody answers for would take their time
first = asked([pin for pin in pins if pin.startswith("numpy==")])
found = asked(pins) if any("vulns" in package for package in first) else []
checked = [package for package in found if "vulns" in package]
known = [(package, entry) for package in checked for entry in package["vulns"]]
for package, entry in known:
    mended = ", ".join(entry["fix_versions"]) or "no version yet"
    print(f"{package['name']} {package['version']}: {entry['id']}, mended in {mended}")
if not checked:
    print("audit: NOT CHECKED for known vulnerabilities: the database was not reached")
else:
    left = len(pins) - len(checked)
    print(
        f"audit: {len(known)} known vulnerabilities in {len(checked)} packages" + f", {left} not checked" * bool(left)
    )
sys.exit(bool(known))
