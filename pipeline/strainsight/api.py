"""strainsight as a library: the steps of a placement as functions, and the results of a run as NumPy arrays.

    from strainsight import api

    case = api.load("configs/cantilever-youngs-modulus.yaml")
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, training)
    layout = api.place(case, mesh, reduced, training, screened)

Every function computes what the stage of the same name writes, from a config and what came before it; nothing is written.
`open_run` reads what a run on the command line has written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from strainsight.cases.resources import silent
from strainsight.config.load import load_config
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, UserError
from strainsight.mesh.model import Mesh
from strainsight.records.mesh import mesh_from
from strainsight.records.placed import Observed, Placed
from strainsight.records.record import Record, read
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.training import Screened, Training
from strainsight.records.validated import Validated
from strainsight.sweep.sweep import Sweep, serial
from strainsight.workflow.artefact import Artefact

if TYPE_CHECKING:
    import pyvista

    from strainsight.cases.structure.placement import Placement

__all__ = ["Case", "Run", "load", "mesh", "modes", "open_run", "place", "reduce", "screen", "train"]


@dataclass(frozen=True)
class Case:
    """A placement as its config states it.

    config: the checked config; files: dotted key ("mesh.file") → input file; progress: called with what is being done and
    the share that is done; sweep: runs one function at many points, in one process unless another is given.
    """

    config: PlacementConfig
    files: Mapping[str, Path]
    progress: Callable[[str, float], None] = silent
    sweep: Sweep = serial


def load(path: Path | str, overrides: Iterable[str] = ()) -> Case:
    """Read and check the config of a placement; overrides as behind --set ("place.keep=6").

    Raises ConfigError that lists every problem with file:line:column, key and remedy.
    """
    from strainsight.stages.placement import stages_for
    from strainsight.workflow.plan import Job, inputs_of

    loaded = load_config(path, overrides)
    config = loaded.model
    if not isinstance(config, PlacementConfig):
        raise ConfigError(
            f"a config of kind {config.kind}", where=str(path), key="kind", remedy="give the config of a placement"
        )
    job = Job(loaded.data, loaded.path.parent, Path("results"), loaded.locate, config)
    stages = stages_for(config.estimate is not None and config.estimate.file is not None, config.validation.truth.model)
    files: dict[str, Path] = {}
    for stage in stages:
        files |= inputs_of(stage, job).files
    return Case(config, files)


def mesh(case: Case) -> Mesh:
    """The deck with what the config adds, checked, in SI units. Raises DeckError with file:line."""
    from strainsight.cases.structure.mesh import checked, mesh_of

    found = mesh_of(case.config.mesh, case.files["mesh.file"])
    checked(found, case.config.mesh)
    return found


def modes(case: Case, mesh: Mesh) -> Modes:
    """Natural frequencies and shapes of the whole model at the guess."""
    from strainsight.cases.structure.reduction import modes_of

    return modes_of(case.config, mesh, case)


def reduce(case: Case, mesh: Mesh, modes_at_guess: Modes | None = None) -> Reduced:
    """The model reduced to a few coordinates, affine in the parameters; its modes are found first where they are not given."""
    from strainsight.cases.structure.reduction import reduced_of

    return reduced_of(case.config, mesh, modes(case, mesh) if modes_at_guess is None else modes_at_guess, case)


def train(case: Case, mesh: Mesh, reduced: Reduced) -> Training:
    """The training run, and what every candidate reads of it."""
    from strainsight.cases.structure.training import trained

    return trained(case.config, mesh, reduced, case).training


def screen(case: Case, training: Training) -> Screened:
    """The noise of every channel, and which candidates go on."""
    from strainsight.cases.structure.training import screened_of

    return screened_of(case.config, training)


def place(case: Case, mesh: Mesh, reduced: Reduced, training: Training, screened: Screened) -> Placement:
    """The layout: elimination, exchanges, a bound on any other, and what it is expected to know.

    `.gauges` are its numbers, the most missed first, `.listed` where they are, `.expected.std` σ of every unknown relative to
    its scale, `.advice` sentences. Raises InfeasibleError where no layout within the limits detects every unknown.
    """
    from strainsight.cases.structure.placement import placement_of
    from strainsight.cases.structure.problem import problem_of

    problem = problem_of(case.config, case.files, reduced, training, screened)
    return placement_of(case.config, mesh, problem, training, screened, case)


@dataclass(frozen=True)
class Run:
    """What a run has written, stage by stage, as records of NumPy arrays; each array is read when it is asked for.

    folder: results/NAME. Raises ArtefactError for a stage that has not run, and for a file that is damaged.
    """

    folder: Path

    def artefact(self, stage: str) -> Artefact:
        """The artefact of a stage: `.summary`, `.tables`, `.message`, and its datasets by path."""
        return Artefact(self.folder / f"{stage}.h5")

    def _record(self, kind: type[Record], stage: str) -> Record:
        return read(kind, self.artefact(stage))

    @property
    def mesh(self) -> Mesh:
        return mesh_from(self.artefact("import"))

    @property
    def modes(self) -> Modes:
        return self._record(Modes, "modes")

    @property
    def reduced(self) -> Reduced:
        return self._record(Reduced, "rom")

    @property
    def training(self) -> Training:
        return self._record(Training, "train")

    @property
    def screened(self) -> Screened:
        return self._record(Screened, "screen")

    @property
    def observed(self) -> Observed:
        return self._record(Observed, "observe")

    @property
    def placed(self) -> Placed:
        return self._record(Placed, "place")

    @property
    def validated(self) -> Validated:
        return self._record(Validated, "validate")

    def to_pyvista(self, stage: str = "import") -> pyvista.DataObject:
        """The grid of a stage: "import" the mesh, "rom" the modes, "place" the pool, "validate" the strain of the candidates."""
        from pyvista import HDFReader

        artefact = self.artefact(stage)
        if "/VTKHDF" not in artefact:
            raise UserError(
                f"the stage '{stage}' writes no grid", where=str(artefact.path), remedy="import, rom, place or validate"
            )
        return HDFReader(str(artefact.path)).read()


def open_run(folder: Path | str) -> Run:
    """The results of a run on the command line, `results/NAME`. Raises UserError where there are none."""
    path = Path(folder)
    if not any(path.glob("*.h5")):
        raise UserError("no results of a run", where=str(path), remedy="give the folder results/NAME of a run")
    return Run(path)
