"""Reading a long record: `python -m benchmarks.reading [samples]`, 10⁶ of 8 channels where no number is given.

One record in every format that `estimate` reads, each read in a process of its own. Prints the size of the file, the processor
time and, on Linux, what memory it took beside the empty process, and what the reader's own process took. The files are
written to a temporary folder, one at a time.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import scipy.io
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter

CHANNELS = tuple(f"G{i + 1}" for i in range(8))
STEP = 1e-3
CHILD = """
import resource, sys
from pathlib import Path
from strainsight.measurements.csv_layout import TextFormat
from strainsight.measurements.reader import read_recording

path, time, decimal = Path(sys.argv[1]), sys.argv[2] or None, sys.argv[3]
usage = lambda: [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
peak = lambda: int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
empty, before = usage()[0], peak()
read_recording(path, sys.argv[4:], time=time, time_unit=time and "s", form=TextFormat(decimal=decimal))
own, child = usage()
print(sum(u.ru_utime + u.ru_stime for u in (own, child)) - empty.ru_utime - empty.ru_stime)
print(peak() - before, child.ru_maxrss)
"""


def text(path: Path, t: np.ndarray, values: np.ndarray, mark: str = ",", decimal: str = ".", quote: str = "") -> None:
    row = mark.join([f"{quote}%.3f{quote}", *[f"{quote}%.6f{quote}"] * len(CHANNELS)]) + "\n"
    with path.open("w", encoding="utf-8") as file:
        file.write(mark.join(["time", *CHANNELS]) + "\n")
        for at in range(0, len(t), 10_000):
            block = np.column_stack([t[at : at + 10_000], values[at : at + 10_000]])
            lines = "".join(row % tuple(line) for line in block.tolist())
            file.write(lines if decimal == "." else lines.replace(".", ","))


def hdf5(path: Path, t: np.ndarray, values: np.ndarray) -> None:
    with h5py.File(path, "w") as file:
        file["time"] = t
        file.update(dict(zip(CHANNELS, values.T, strict=True)))


def mdf(path: Path, t: np.ndarray, values: np.ndarray) -> None:
    with MDF() as file:
        file.append([Signal(column.copy(), t, name=name) for name, column in zip(CHANNELS, values.T, strict=True)])
        file.save(path)


def tdms(path: Path, t: np.ndarray, values: np.ndarray) -> None:
    with TdmsWriter(path) as file:
        columns = zip(CHANNELS, values.T, strict=True)
        file.write_segment(
            [ChannelObject("rig", name, column.copy(), {"wf_increment": STEP}) for name, column in columns]
        )


def mat(path: Path, t: np.ndarray, values: np.ndarray) -> None:
    scipy.io.savemat(path, {"time": t, **dict(zip(CHANNELS, values.T, strict=True))})


WRITERS: dict[str, tuple[str, Callable[[Path, np.ndarray, np.ndarray], None]]] = {
    "CSV": ("a.csv", text),
    "CSV, decimal commas": ("de.csv", partial(text, mark=";", decimal=",")),
    "CSV, cells in quotes": ("quoted.csv", partial(text, quote='"')),
    "HDF5": ("a.h5", hdf5),
    "MDF4": ("a.mf4", mdf),
    "TDMS": ("a.tdms", tdms),
    "MAT 5": ("a.mat", mat),
}


def main(samples: int) -> None:
    t, values = STEP * np.arange(samples), 100 * np.random.default_rng(0).normal(size=(samples, len(CHANNELS)))
    print(f"{'':22} {'file':>9} {'processor':>10} {'memory':>9} {'of the reader':>14}")
    with tempfile.TemporaryDirectory() as folder:
        for name, (file, write) in WRITERS.items():
            path = Path(folder) / file
            write(path, t, values)
            time = "" if path.suffix in (".mf4", ".tdms") else "time"
            words = [str(path), time, "," if file == "de.csv" else ".", *CHANNELS]
            said = subprocess.run([sys.executable, "-c", CHILD, *words], check=True, capture_output=True, text=True)
            seconds, own, child = map(float, said.stdout.split())
            size = path.stat().st_size / 1e6
            print(f"{name:22} {size:6.0f} MB {seconds:8.1f} s {own / 1e3:6.0f} MB {child / 1e3:11.0f} MB", flush=True)
            path.unlink()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10**6)
