"""Runs the commands of the gallery, checks what its pages quote, and takes the picture of each.

`python docs/gallery_pages.py [NAME …]`; the build of the manual calls it for the pages that are out of date. Pictures and what
was printed stay beside the pages and are not kept in the repository. Every number with a unit in the words of a page has to be
one that was printed, or one of the config.
"""

from __future__ import annotations

import math
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from quoted import TOLERANCE, blocks, commands, missing

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "gallery"
WORK = ROOT / "build" / "gallery"
NUMBER = r"(?<![\w.])(\d+(?:\.\d+)?(?:e[+-]?\d+)?)"
UNIT = r"\s?(%|µm/m\b|MPa\b|Hz\b|h\b|N\b)"
PICTURES = ("view", "figures")
"""Commands that draw, and print nothing that is quoted."""


def names() -> list[str]:
    """The pages, in the order in which the gallery lists them."""
    listed = re.search(r"```{toctree}\n(?::[^\n]*\n)*(.*?)```", (FOLDER / "index.md").read_text(encoding="utf-8"), re.DOTALL)
    return listed[1].split() if listed else []


def laid_out(folder: Path) -> Path:
    """A copy of the configs, with the files that they name at the same places about it: where the commands run.

    Without results of an earlier time: a stage that is up to date does not print what a page quotes.
    """
    there = folder / "docs" / "gallery"
    shutil.rmtree(there, ignore_errors=True)
    there.mkdir(parents=True)
    for config in FOLDER.glob("*.yaml"):
        shutil.copyfile(config, there / config.name)
        for named in re.findall(r"\.\./[\w./-]+\w", config.read_text(encoding="utf-8")):
            (there / named).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(FOLDER / named, there / named)
    return there


def run(name: str, there: Path, pictures: bool = True) -> str:
    """Run the commands of a page in its folder: what they printed.

    pictures: whether those that only draw are run, too. Raises RuntimeError where a command fails, and where a line that is
    quoted or a number of the text was not printed.
    """
    text = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    everything, code = "", 0
    for block in blocks(text):
        for command, quoted in commands(block):
            if command == "echo $?":
                said, code = f"{code}\n", 0
            elif code:
                raise RuntimeError(f"{name}.md: a command ended with {code}, and the page does not say so\n{everything}")
            elif pictures or command.split()[1] not in PICTURES:
                code, said = _called(command, there)
            else:
                continue
            if lost := missing(quoted, said):
                raise RuntimeError(f"{name}.md: {command} does not print\n{lost[0]}\nbut\n{said}")
            everything += said
    if code:
        raise RuntimeError(f"{name}.md: the last command ended with {code}\n{everything}")
    stated = "".join((FOLDER / own).read_text(encoding="utf-8") for own in re.findall(r"{literalinclude} (\S+)", text))
    if wrong := unfounded(text, everything, stated):
        raise RuntimeError(f"{name}.md: {', '.join(wrong)} is not what was printed\n{everything}")
    return everything


def unfounded(text: str, printed: str, stated: str) -> list[str]:
    """The numbers with a unit in the words of a page that were not printed, a share as a share, and are not stated either."""
    words = re.sub(r"```.*?```|`[^`\n]*`|\(\S+\)", "", text, flags=re.DOTALL)
    shares, others, given = (
        [float(number) for number in re.findall(NUMBER + of, there)]
        for of, there in ((r"\s?%", printed), ("", printed), ("", stated))
    )
    return [
        f"{number} {unit}"
        for number, unit in re.findall(NUMBER + UNIT, words)
        if not any(math.isclose(float(number), one, rel_tol=TOLERANCE) for one in (shares if unit == "%" else others))
        and float(number) not in given
    ]


def _called(command: str, there: Path) -> tuple[int, str]:
    """Exit code and what a `strainsight` command prints: in this process, which has loaded everything already."""
    from typer.testing import CliRunner

    from strainsight_cli.main import app

    program, *arguments = shlex.split(command)
    if program != "strainsight":
        raise RuntimeError(f"not a command of strainsight: {command}")
    before = Path.cwd()
    os.chdir(there)
    try:
        done = CliRunner(env={"NO_COLOR": "1"}).invoke(app, arguments)
    finally:
        os.chdir(before)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code, done.output


def take(name: str, there: Path) -> None:
    """Put the picture of a page beside it: the screenshot of its name, or the figure that its comment names."""
    text = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    named = re.search(r"<!-- picture: (\S+) -->", text)
    source = there / (named[1] if named else f"{name}.png")
    shutil.copyfile(source, FOLDER / f"{name}{source.suffix}")


def out_of_date() -> list[str]:
    """The pages whose output is older than the page, the configs or the package."""
    package = max(path.stat().st_mtime for path in (ROOT / "pipeline").rglob("*.py"))
    configs = max(path.stat().st_mtime for path in FOLDER.glob("*.yaml"))
    kept = {name: FOLDER / f"{name}.out" for name in names()}
    return [
        name
        for name, out in kept.items()
        if not out.exists()
        or out.stat().st_mtime < max(package, configs, (FOLDER / f"{name}.md").stat().st_mtime)
    ]


def write() -> None:
    """Bring the pages up to date, in a process of its own. Raises RuntimeError with what it said where one fails."""
    if stale := out_of_date():
        done = subprocess.run([sys.executable, __file__, *stale], capture_output=True, check=False)
        if done.returncode:
            raise RuntimeError(done.stderr.decode(errors="replace"))


def main(wanted: Sequence[str]) -> None:
    there = laid_out(WORK)
    for name in wanted:
        printed = run(name, there)
        take(name, there)
        (FOLDER / f"{name}.out").write_text(printed, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:] or names())
