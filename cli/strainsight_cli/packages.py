"""Python and the packages, against the ranges that pyproject.toml asks for."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from strainsight_cli.checks import FAILS, GOOD, WARNING, Finding
from strainsight_cli.trials import tried

MODULES = {"ruamel.yaml": "ruamel.yaml", "ruamel-yaml": "ruamel.yaml"}
"""Package → module, where they differ."""
CAN_DO_WITHOUT = ("pypardiso",)
"""Its row `solver` says what that costs."""


def check_packages() -> list[Finding]:
    """Version of Python and of every package, then whether each can be imported, in a process that may crash."""
    python, requirements = asked_for()
    findings = compared(python, requirements)
    present = [finding.subject for finding in findings if finding.verdict == GOOD and finding.subject != "python"]
    found, ended = tried("imports", [MODULES.get(name, name) for name in present])
    broken: dict[str, str] = dict(found.get("failed", {}))
    if ended:
        broken[found.get("at", "")] = ended
    return [
        Finding(own.subject, FAILS, f"{own.found}; import: {why}", f"pip install --force-reinstall {own.subject}")
        if (why := broken.get(MODULES.get(own.subject, own.subject)))
        else own
        for own in findings
    ]


def asked_for() -> tuple[str, list[str]]:
    """(range of Python, requirements): of the checkout's pyproject.toml, or as installed.

    What pip noted when a checkout was installed may be older than its pyproject.toml.
    """
    import tomllib

    import strainsight

    file = Path(strainsight.__file__).parents[2] / "pyproject.toml"
    if file.is_file():
        project = tomllib.loads(file.read_text(encoding="utf-8")).get("project", {})
        if project.get("name") == "strainsight":
            return project["requires-python"], list(project["dependencies"])
    noted = metadata.metadata("strainsight")
    asked = [line for line in noted.get_all("Requires-Dist") or [] if "extra ==" not in line]
    return (noted.get_all("Requires-Python") or [""])[0], asked


def compared(python: str, requirements: Sequence[str]) -> list[Finding]:
    """Every version beside its range; requirements of other machines are left out."""
    try:
        from packaging.requirements import Requirement
        from packaging.specifiers import SpecifierSet
    except ImportError:
        return [Finding("packaging", FAILS, "not installed: no version can be compared", "pip install packaging")]
    own = platform.python_version()
    within = SpecifierSet(python).contains(own, prereleases=True)
    findings = [_finding("python", own, python, within, f"take Python {python}: make PYTHON=/path/to/python")]
    for line in requirements:
        asked = Requirement(line)
        if asked.marker is not None and not asked.marker.evaluate():
            continue
        wanted = str(asked.specifier)
        remedy = f"pip install '{asked.name}{wanted}'"
        try:
            version = metadata.version(asked.name)
        except metadata.PackageNotFoundError:
            verdict, need = (WARNING, "wanted") if asked.name in CAN_DO_WITHOUT else (FAILS, "needed")
            findings.append(Finding(asked.name, verdict, f"not installed, {wanted} is {need}", remedy))
            continue
        findings.append(
            _finding(asked.name, version, wanted, asked.specifier.contains(version, prereleases=True), remedy)
        )
    return findings


def _finding(subject: str, version: str, wanted: str, within: bool, remedy: str) -> Finding:
    if within:
        return Finding(subject, GOOD, f"{version} ({wanted})")
    return Finding(subject, FAILS, f"{version}, {wanted} is needed", remedy)
