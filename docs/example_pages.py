"""Runs the examples and writes a page of each: its comments as prose, its code, what it printed and drew.

`python docs/example_pages.py`; the build of the manual calls it. Pages and pictures are not kept in the repository.
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "docs" / "examples"
PROSE = re.compile(r"^(?:# .*\n)+", re.MULTILINE)
LONGEST = 900


def scripts() -> list[Path]:
    """All examples."""
    return sorted(EXAMPLES.glob("*.py"))


def page(script: Path, printed: str) -> str:
    """The script as Markdown, with what it printed and drew."""
    text = script.read_text(encoding="utf-8")
    tree = ast.parse(text)
    body = "".join(text.splitlines(keepends=True)[tree.body[0].end_lineno :])
    parts = [f"# {(ast.get_docstring(tree) or script.stem).rstrip('.')}"]
    start = 0
    for comment in [*PROSE.finditer(body), None]:
        code = body[start : comment.start() if comment else None].strip()
        parts += [f"```python\n{code}\n```"] if code else []
        if comment:
            parts.append(" ".join(line.removeprefix("# ") for line in comment[0].splitlines()))
            start = comment.end()
    if printed:
        parts.append(f"It prints\n```\n{printed.rstrip()}\n```")
    pictures = (script.with_suffix(ending) for ending in (".svg", ".png"))
    parts += [f"![{script.stem}]({picture.name})" for picture in pictures if picture.exists()]
    return "\n\n".join(parts) + "\n"


def printed_by(script: Path) -> str:
    """What it prints, run from the folder of the repository; kept beside it until the script or the package is newer.

    Raises RuntimeError with what it said where it fails.
    """
    kept = script.with_suffix(".out")
    sources = [*EXAMPLES.glob("test.*"), script, *(ROOT / "pipeline").rglob("*.py")]
    if not kept.exists() or kept.stat().st_mtime < max(source.stat().st_mtime for source in sources):
        done = subprocess.run(
            [sys.executable, script],
            cwd=ROOT,
            env={**os.environ, "NO_COLOR": "1"},
            capture_output=True,
            timeout=LONGEST,
        )
        if done.returncode:
            raise RuntimeError(f"{script.name} ended with {done.returncode}: {done.stderr.decode(errors='replace')}")
        kept.write_bytes(done.stdout)
    return kept.read_text(encoding="utf-8")


def write(run: bool = True) -> None:
    """Every page, where it changed; run: whether scripts whose output is out of date are run."""
    for script in scripts():
        text = page(script, printed_by(script) if run else "")
        there = script.with_suffix(".md")
        if not there.exists() or there.read_text(encoding="utf-8") != text:
            there.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write()
