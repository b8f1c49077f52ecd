"""Draws the history of the benchmarks and writes it as a table, from benchmarks/history/*.json.

`python docs/benchmark_history.py FOLDER`; the build of the manual calls it. Neither is kept in the repository.
"""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

ENTRIES = Path(__file__).resolve().parents[1] / "benchmarks" / "history"
STYLE = {"svg.fonttype": "none", "svg.hashsalt": "strainsight", "font.family": "sans-serif", "font.size": 9}


def entries(folder: Path = ENTRIES) -> list[dict[str, Any]]:
    """All entries, in the order of their commits."""
    found = [json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json")]
    return sorted(found, key=lambda entry: (entry["committed"], entry["commit"]))


def jobs(history: list[dict[str, Any]]) -> list[str]:
    """Names of all jobs, in the order in which they came up."""
    return list(dict.fromkeys(name for entry in history for name in entry["ratios"]))


def picture(history: list[dict[str, Any]]) -> str:
    """Ratio of every job over the commits, median with least and largest, as SVG."""
    with rc_context(STYLE):
        figure = Figure(figsize=(8, 4.5), layout="constrained")
        axes = figure.add_subplot()
        for name in jobs(history):
            at = [i for i, entry in enumerate(history) if name in entry["ratios"]]
            least, ratio, largest = (
                np.array([history[i]["ratios"][name][key] for i in at]) for key in ("least", "ratio", "largest")
            )
            line = axes.errorbar(at, ratio, (ratio - least, largest - ratio), marker="o", capsize=3)[0]
            axes.annotate(
                name, (at[-1], ratio[-1]), (8, 0), textcoords="offset points", va="center", color=line.get_color()
            )
        axes.axhline(1, color="0.5", linewidth=0.8)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set_ylabel("processor time of the peer over ours")
        axes.set_xlim(-0.5, len(history))
        axes.set_xticks(range(len(history)), [f"{e['committed'][:10]}\n{e['commit'][:7]}" for e in history])
        axes.grid(alpha=0.3, which="both")
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()


def table(history: list[dict[str, Any]]) -> str:
    """The newest entry job by job, then the ratios of all entries, newest first."""
    newest, names = history[-1], jobs(history)
    lines = ["| job | what | peer | ours [s] | peer [s] | times as long | least, largest |", "|" + "---|" * 7]
    for name, found in newest["ratios"].items():
        numbers = (f"{found[key]:g}" for key in ("own", "theirs", "ratio"))
        spread = f"{found['least']:g}, {found['largest']:g}"
        lines.append(f"| {' | '.join((name, found['what'], found['peer'], *numbers, spread))} |")
    if "stages" in newest:
        lines += ["", f"| command | commit {newest['reference'][:7]} [s] | ours [s] | ratio | peak memory of both [GiB] |"]
        lines.append("|" + "---|" * 5)
        for name, found in newest["stages"].items():
            numbers = (f"{found[key]:.3g}" for key in ("reference_time", "time", "ratio"))
            memory = f"{found['reference_memory']:.2f}, {found['memory']:.2f}"
            lines.append(f"| {' | '.join((name, *numbers, memory))} |")
    versions = ", ".join(f"{name} {number}" for name, number in newest["versions"].items())
    lines += ["", f"Commit {newest['commit'][:7]}, measured on {newest['measured'][:10]} with {versions}.", ""]
    lines += [f"| commit | of | processor, cores | {' | '.join(names)} |", "|---|---|---|" + "---|" * len(names)]
    for entry in reversed(history):
        machine = f"{entry['machine']['processor']}, {entry['machine']['cores']}"
        ratios = (entry["ratios"].get(name) for name in names)
        cells = " | ".join("–" if found is None else f"{found['ratio']:g}" for found in ratios)
        lines.append(f"| {entry['commit'][:7]} | {entry['committed'][:10]} | {machine} | {cells} |")
    return "\n".join(lines) + "\n"


def write(folder: Path) -> None:
    """`ratios.svg` and `table.txt` in `folder`; what says the same is left alone."""
    folder.mkdir(parents=True, exist_ok=True)
    history = entries()
    for name, content in (("ratios.svg", picture(history)), ("table.txt", table(history))):
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != content:
            path.write_text(content, encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
