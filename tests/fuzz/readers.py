"""The product's readers on one file, and what is wrong with how they end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

from strainsight.errors import StrainsightError

from .cases import OVERRIDES


def read_config(path: Path, choice: int) -> None:
    """The file with up to two overrides; of a suite also its runs."""
    from strainsight.config.load import load_config
    from strainsight.config.suite import SuiteConfig
    from strainsight.config.suite_runs import runs_of

    rng = Random(choice)
    overrides = rng.sample(OVERRIDES, rng.choice((0, 0, 1, 2)))
    loaded = load_config(path, overrides)
    assert isinstance(loaded.data, dict)
    if isinstance(loaded.model, SuiteConfig):
        runs_of(loaded)


def read_deck(path: Path, choice: int, sandboxed: bool = True) -> None:
    from strainsight.decks.other import mesh as other
    from strainsight.foreign.matrices.files import read_matrix, read_numbering, symmetric

    ending = path.with_suffix("").suffix if path.suffix == ".gz" else path.suffix
    if ending in (".op4", ".mtx", ".npz"):
        symmetric(read_matrix(path, (None, "k", "K")[choice % 3]), path)
    elif ending == ".csv":
        read_numbering(path)
    else:
        from strainsight.config.mesh import MaterialSection, MeshFile
        from strainsight.decks.other.load import load, load_sandboxed
        from strainsight.experiment.structure.mesh import checked, mesh_of

        if path.suffix == ".h5":
            path = path.with_name("case-of-h5.xdmf")
        steel = MaterialSection(regions="all", youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
        config = MeshFile(
            file=path.name,
            length_unit="m" if choice % 2 else "mm",
            region_data="region" if choice % 8 == 0 else None,
            ignore=("CQUAD4", "CTRIA3", "TIE"),
            materials={} if ending in (".bdf", ".inp") else {"steel": steel},
        )
        with patch.object(other, "load_sandboxed", load_sandboxed if sandboxed else load):
            checked(mesh_of(config, path), config)


def read_measurement(path: Path, choice: int, sandboxed: bool = True) -> None:
    """The channels on the clock of a filter; a table now and then as a load's history."""
    from strainsight.config.loads import RecordedSection
    from strainsight.experiment.recorded import recorded
    from strainsight.measurements import reader
    from strainsight.measurements.assemble import assemble
    from strainsight.measurements.calibration import ChannelSettings
    from strainsight.measurements.reader import read_recording

    time: str | None = "time"
    if path.suffix == ".uff":
        time, channels = None, [("12:3",), ("gauge 1",), ("12:+Z", "13:3")][choice % 3]
    elif path.suffix == ".h5":
        channels = [("a",), ("group/table[1]",), ("a", "link[0]")][choice % 3]
    elif choice % 4 == 0:
        stated = RecordedSection(type="csv", file=path.name, time_column="time", value_column="F")
        recorded("loads.tip.signal", stated, path)
        return
    else:
        channels = ("a",)
    if path.suffix == ".h5" and not sandboxed:
        recording = reader.read_binary("hdf5", path, channels, time="time", sandboxed=False)
    else:
        recording = read_recording(path, channels, time=time, time_unit=(None, None, "s")[choice % 3])
    settings = {name: ChannelSettings("um/m", override=choice % 2 > 0) for name in channels}
    assemble(recording, settings, (None, 1e-3, 5e-4)[choice % 3])


def read_results(path: Path, choice: int, sandboxed: bool = True) -> None:
    from strainsight.foreign.results.reader import read_responses

    for response in read_responses(path):
        assert response.motion.shape[0] == response.node_ids.size


READERS: dict[str, Callable[..., None]] = {
    "config": read_config,
    "deck": read_deck,
    "measurement": read_measurement,
    "results": read_results,
}


def fault_of(read: Callable[..., Any], path: Path, choice: int) -> str | None:
    """What is wrong with how the reader ends, None where it reads or refuses as it should."""
    try:
        read(path, choice)
    except StrainsightError as error:
        return _unfit(error)
    except Exception as error:
        return _said("left the reader", error)
    return None


def _unfit(error: StrainsightError) -> str | None:
    """Is the message one that a terminal may print, and was memory not what ran out?"""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, MemoryError | RecursionError) and not str(error).count("nested too deeply"):
            return _said("was met on the way", cause)
        cause = cause.__context__
    unprintable = sorted({sign for sign in str(error) if not sign.isprintable() and sign != "\n"})
    if unprintable:
        return f"a message with {unprintable[:5]}: {str(error)[:200]!r}"
    if any(len(line) > 6000 for line in str(error).split("\n")):
        return f"a message of {len(str(error))} signs: {str(error)[:100]!r}"
    return f"exit code {error.exit_code}: {error}" if error.exit_code != 2 else None


def _said(what: str, error: BaseException) -> str:
    import traceback

    place = traceback.extract_tb(error.__traceback__)[-4:]
    ours: Sequence[Any] = [frame for frame in place if "strainsight" in frame.filename] or place
    where = " < ".join(f"{Path(frame.filename).name}:{frame.lineno}" for frame in reversed(ours))
    return f"{type(error).__name__} {what} at {where}: {str(error)[:150]}"
