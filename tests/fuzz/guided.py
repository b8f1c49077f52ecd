"""python -m tests.fuzz.guided [--seconds 60] [--group deck …]: damaged files that atheris makes, led by the lines they reach.

atheris has wheels for Linux only; elsewhere this says so and does nothing.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from random import Random

from .cases import Group, companions
from .guard import MEMORY, SECONDS, Hung, soon
from .readers import READERS, fault_of
from .seeds import ROOT, write_seeds

PLAIN = {
    "config": (".yaml",),
    "deck": (".bdf", ".inp", ".msh", ".op4", ".mtx", ".npz", ".csv"),
    "measurement": (".csv", ".uff"),
    "results": (".op2", ".pch", ".unv", ".frd"),
}
"""Group → endings of the files that this process reads itself; the first byte of an input says which it is."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60, help="for each group")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--group", nargs="+", default=list(READERS), choices=list(READERS))
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "fuzz")
    parser.add_argument("--here", type=Path, help="for the process that this one starts: its folder")
    asked = parser.parse_args()
    try:
        import atheris  # noqa: F401
    except ImportError:
        print("atheris cannot be had here: nothing done")
        return 0
    if asked.here is not None:
        _run(asked.group[0], asked.here, asked.seconds, asked.seed, asked.out)
        return 0
    asked.out.mkdir(parents=True, exist_ok=True)
    bad = 0
    with tempfile.TemporaryDirectory() as made:
        write_seeds(Path(made) / "seeds")
        for name in asked.group:
            words = [
                "--group",
                name,
                "--seconds",
                str(asked.seconds),
                "--seed",
                str(asked.seed),
                "--out",
                str(asked.out),
            ]
            command = [sys.executable, "-m", "tests.fuzz.guided", *words, "--here", made]
            done = subprocess.run(command, cwd=ROOT, stderr=subprocess.PIPE, check=False)
            said = done.stderr.decode("utf-8", "replace").splitlines()
            runs = next((line for line in reversed(said) if line.startswith("Done ")), f"ended with {done.returncode}")
            faults = [line for line in said if "AssertionError" in line or "ERROR" in line]
            print(f"{name}: {runs}", *faults[:5], sep="\n  ", flush=True)
            bad += done.returncode != 0
    return 1 if bad else 0


def _run(name: str, made: Path, seconds: int, seed: int, out: Path) -> None:
    import atheris

    warnings.simplefilter("ignore")
    with atheris.instrument_imports(include=["strainsight"]):
        import strainsight.config.load
        import strainsight.config.suite_runs
        import strainsight.decks.abaqus.deck
        import strainsight.decks.gmsh.mesh
        import strainsight.decks.nastran.deck
        import strainsight.experiment.recorded
        import strainsight.foreign.matrices.files
        import strainsight.foreign.results.reader
        import strainsight.measurements.assemble
        import strainsight.measurements.reader
        import strainsight.stages.import_mesh  # noqa: F401
    group = Group(name, made / "seeds" / name)
    folder, corpus = made / f"{name}-guided", made / f"{name}-corpus"
    companions(name, made / "seeds" / name, folder)
    corpus.mkdir()
    endings = PLAIN[name]
    for path, content in group.files.items():
        if (ending := Path(path).suffix) in endings:
            (corpus / path).write_bytes(bytes([endings.index(ending)]) + content)
    (made / f"{name}-words").write_text(
        "".join(f'"{_escaped(word)}"\n' for word in group.words if 0 < len(word) < 60), "utf-8"
    )
    os.chdir(folder)

    def one(data: bytes) -> None:
        path = folder / f"case{endings[data[0] % len(endings)] if data else endings[0]}"
        path.write_bytes(data[1:])
        try:
            with soon():
                fault = fault_of(READERS[name], path, Random(data[:64]).randrange(1 << 16))
        except Hung:
            fault = "no end within ten seconds"
        path.unlink()
        assert not fault, fault

    flags = [f"-max_total_time={seconds}", f"-seed={seed}", "-max_len=16000", f"-timeout={6 * SECONDS:.0f}"]
    flags += [f"-rss_limit_mb={2 * MEMORY >> 20}", f"-artifact_prefix={out}/{name}-guided-", "-print_final_stats=1"]
    atheris.Setup([sys.argv[0], *flags, f"-dict={made / f'{name}-words'}", str(corpus)], one)
    atheris.Fuzz()


def _escaped(word: str) -> str:
    """A word as libFuzzer's dictionaries write it."""
    return "".join(f"\\x{byte:02x}" for byte in word.encode())


if __name__ == "__main__":
    sys.exit(main())
