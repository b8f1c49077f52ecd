"""The angle bracket of tests/stages/angle_record.py by CalculiX: `python -m benchmarks.angle_by_calculix` writes its data."""

from __future__ import annotations

import runpy
import subprocess
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

RECORD = SimpleNamespace(
    **runpy.run_path(str(Path(__file__).resolve().parents[1] / "tests" / "stages" / "angle_record.py"))
)


def calculix_deck(acting: dict[str, np.ndarray], seen: np.ndarray) -> str:
    """The deck of CalculiX, in mm, t, s: what is seen are displacements of these nodes."""
    made, fine = RECORD.meshes(), RECORD.plate()
    elements = made["tetrahedra"](fine)
    chosen = made["sets"](fine)
    lines = ["*NODE,NSET=ALL"]
    lines += [f"{i + 1},{x:.10g},{y:.10g},{z:.10g}" for i, (x, y, z) in enumerate(fine.position.tolist())]
    lines.append("*ELEMENT,TYPE=C3D10,ELSET=ALL")
    lines += [",".join(map(str, [e, *(nodes + 1)])) for e, nodes in enumerate(elements, start=1)]
    lines += ["*NSET,NSET=SEEN", *(f"{node + 1}," for node in seen)]
    lines += [
        "*MATERIAL,NAME=STEEL",
        "*ELASTIC",
        f"{RECORD.SOFTER * RECORD.GUESS:.10g},{RECORD.NU}",
        "*DENSITY",
        f"{RECORD.DENSITY}",
    ]
    lines += ["*SOLID SECTION,ELSET=ALL,MATERIAL=STEEL", "*BOUNDARY", *(f"{node + 1},1,3" for node in chosen[21][1])]
    for name, history in acting.items():
        lines.append(f"*AMPLITUDE,NAME={name.upper()}")
        lines += [f"{k / RECORD.RATE:.6f},{value:.9g}" for k, value in enumerate(history.tolist())]
    n = len(next(iter(acting.values()))) - 1
    lines += ["*STEP", "*FREQUENCY,STORAGE=YES", str(RECORD.MODES), "*END STEP"]
    lines += [
        f"*STEP,INC={n + 1}",
        "*MODAL DYNAMIC",
        f"{1 / RECORD.RATE},{n / RECORD.RATE}",
        "*MODAL DAMPING",
        f"1,{RECORD.MODES},{RECORD.DAMPING}",
    ]
    for name in acting:
        nodes, (axis,) = chosen[RECORD.NODE_SETS[name]][1], np.flatnonzero(RECORD.DIRECTIONS[name])
        lines.append(f"*CLOAD,AMPLITUDE={name.upper()}")
        lines += [f"{node + 1},{axis + 1},{RECORD.DIRECTIONS[name][axis] / len(nodes)}" for node in nodes]
    lines += ["*NODE PRINT,NSET=SEEN,FREQUENCY=1", "U", "*END STEP", ""]
    return "\n".join(lines)


def simulated(acting: dict[str, np.ndarray], wanted: list[Any], folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (modes,) [Hz] and the strain (samples, grids) by CalculiX; the first sample is one step after 0 s."""
    seen = np.unique([span.ends for span in wanted])
    (folder / "angle.inp").write_text(calculix_deck(acting, seen))
    subprocess.run(["ccx", "angle"], cwd=folder, check=True, stdout=subprocess.DEVNULL, timeout=1800)
    rows = [line.split() for line in (folder / "angle.dat").read_text().splitlines()]
    frequency = [float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()][: RECORD.MODES]
    values = np.array([[float(cell) for cell in row[1:]] for row in rows if len(row) == 4 and row[0].isdigit()])
    moved = values.reshape(-1, len(seen), 3)
    first, last = (np.searchsorted(seen, [span.ends[k] for span in wanted]) for k in (0, 1))
    direction, length = np.array([s.direction for s in wanted]), np.array([s.length for s in wanted])
    return np.array(frequency), np.einsum("tgi,gi->tg", moved[:, last] - moved[:, first], direction) / length


def main() -> None:
    """Write data/angle.npz."""
    wanted, histories = RECORD.spans(RECORD.GAUGES) + RECORD.spans(RECORD.POINTS), RECORD.loads()
    kept: dict[str, Any] = {}
    for record, names in (("alone", ["tip"]), ("shaken", ["tip", "shaker"])):
        with tempfile.TemporaryDirectory() as folder:
            frequency, strain = simulated({name: histories[name] for name in names}, wanted, Path(folder))
        kept["frequency"] = frequency
        digits = np.rint(strain / RECORD.STEP).astype(np.int32)
        # differences in time are small numbers, which zip packs better
        kept[record] = np.diff(digits, axis=0, prepend=0).T.copy()
    np.savez_compressed(RECORD.DATA, **kept)


if __name__ == "__main__":
    main()
