"""A stage is a function: config slice and upstream artefacts in, one Output out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Generic, TypeVar

from strainsight.parallel import Sweep, serial
from strainsight.runner.artefact import Artefact
from strainsight.runner.output import Output

Config = TypeVar("Config", covariant=True)


@dataclass(frozen=True)
class Context(Generic[Config]):
    """All that a stage may look at.

    config    the frozen config model with the declared keys only: `config.place.keep`, `config.loads["tip"].node`; all else
              is an AttributeError. Of a job without a model, its data by attributes. `Context[PlacementConfig]` is that of a
              stage of a placement; a function that does not look at the config takes a `Context[object]`
    upstream  stage name → Artefact, opened when asked for
    files     dotted key ("mesh.file", "loads.gust.signal.file") → path of that input file
    base      the folder that paths of the config start from, for a key that names a folder; what is read there is returned as
              `Output.inputs`
    progress  progress("elimination", 0.4): what is being done and the share that is done
    notice    says a sentence to the user at once, which is no result
    sweep     runs one function at many points, wherever the user wants that: the results are the same
    """

    config: Config
    upstream: Mapping[str, Artefact]
    files: Mapping[str, Path]
    progress: Callable[[str, float], None]
    sweep: Sweep = serial
    notice: Callable[[str], None] = lambda text: None
    base: Path = Path()


@dataclass(frozen=True)
class Stage:
    """A step of a pipeline; results/<name>/<stage>.h5 is its artefact.

    name      "place"
    version   raised when the same inputs would give another result
    reads     dotted config keys it may read, `*` for every key of a mapping: ("mesh", "loads.*.node", "seed")
    upstream  names of the stages whose artefacts it may read
    files     dotted keys whose values are input files: ("mesh.file", "loads.*.signal.file"), covered by `reads`; keys
              that the config lacks are passed over. A plain name under a key `from` stands for
              results/<that name>/validate.h5, or that of `stage`; under `measured.from` for its simulate.h5
    run       the function, for one kind of config; `Imported` if its module loads kernels
    records   files next to the artefact whose previous content is kept as NAME-digits.csv
    check     check of the whole config before any stage runs; it does not affect results
    """

    name: str
    version: int
    reads: tuple[str, ...]
    upstream: tuple[str, ...]
    files: tuple[str, ...]
    run: Callable[[Context[Any]], Output]
    check: Callable[[Any, Path], None] | None = None
    records: tuple[str, ...] = ()

    @property
    def module(self) -> str:
        """Name of the module of its function."""
        return self.run.module if isinstance(self.run, Imported) else self.run.__module__


@dataclass(frozen=True)
class Imported:
    """Function of a module that is imported when the function is called: a list of stages loads no kernel. Other processes
    receive the two names."""

    module: str
    name: str

    def __call__(self, *arguments: Any) -> Any:
        return getattr(import_module(self.module), self.name)(*arguments)
