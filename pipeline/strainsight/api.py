"""strainsight as a library: the steps of a placement as functions, and the results of runs as NumPy arrays.

    from strainsight import api

    case = api.load("configs/cantilever-youngs-modulus.yaml")
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, mesh, reduced, training)
    layout = api.place(case, mesh, reduced, training, screened)
    validation = api.validate(case, mesh, reduced, training, screened, layout.gauges)

Every function computes what the stage of the same name writes, from a config and what came before it; nothing is written.
Those of a bench are methods of what `bench` returns.

    bench = api.bench("configs/bench/gauges.yaml")
    meshes = bench.meshes()
    bodies = bench.reduce(meshes)
    layout = bench.place(meshes, bodies)
    motion = bench.simulate(meshes, bodies, layout)
    estimate = bench.estimate(meshes, bodies, layout)

`place_arrays` and `place_modes` place gauges without a deck, on plain arrays. `open_run` reads what a run on the command line has
written, `open_bench` what one of a bench has. The classes of all that is returned are names of this module."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.load import load_config
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError
from strainsight.experiment.system import silent
from strainsight.mesh.model import Mesh
from strainsight.parallel import Sweep, serial
from strainsight.placement.arrays import ArrayPlacement, place_arrays, place_modes
from strainsight.placement.criteria import Criterion
from strainsight.records.bench import BenchEstimated, ReducedBodies, ReducedBody, Simulated
from strainsight.records.bench_placed import BenchPlaced
from strainsight.records.mesh import Meshes
from strainsight.records.placed import HotSpots, Observed
from strainsight.records.record import read
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.training import Screened, Training
from strainsight.runner.output import InMemory
from strainsight.runner.stage import Context
from strainsight.runs import BenchRun, Run, open_bench, open_run, to_pyvista

if TYPE_CHECKING:
    from strainsight.experiment.layout.advice import Expectation
    from strainsight.experiment.structure.campaign import Campaign
    from strainsight.experiment.structure.estimation import Estimation
    from strainsight.experiment.structure.placement import StructurePlacement
    from strainsight.experiment.structure.structure import Structure
    from strainsight.experiment.structure.validation import Validation
    from strainsight.runner.plan import Job
    from strainsight.runner.stage import Stage

Gauges = Sequence[int] | np.ndarray
"""Numbers of gauges, as train.h5 counts the candidates; `gauges` of a placement are those of its layout, G1 first."""

_RETURNED = {
    "Campaign": "experiment.structure.campaign",
    "Estimation": "experiment.structure.estimation",
    "Expectation": "experiment.layout.advice",
    "StructurePlacement": "experiment.structure.placement",
    "Validation": "experiment.structure.validation",
}
"""Classes of results whose modules are imported by the function that returns them."""

__all__ = [
    "ArrayPlacement",
    "BenchCase",
    "BenchEstimated",
    "BenchPlaced",
    "BenchRun",
    "Campaign",
    "Case",
    "Criterion",
    "Estimation",
    "Expectation",
    "Gauges",
    "HotSpots",
    "Mesh",
    "Modes",
    "Observed",
    "Reduced",
    "ReducedBody",
    "Run",
    "Screened",
    "Simulated",
    "StructurePlacement",
    "Training",
    "Validation",
    "bench",
    "campaign",
    "estimate",
    "expect",
    "hot_spots",
    "load",
    "mesh",
    "modes",
    "observe",
    "open_bench",
    "open_run",
    "place",
    "place_arrays",
    "place_modes",
    "reduce",
    "screen",
    "to_pyvista",
    "train",
    "validate",
]


def __getattr__(name: str) -> Any:
    """The class of a result, by its name."""
    if name in _RETURNED:
        return getattr(import_module(f"strainsight.{_RETURNED[name]}"), name)
    raise AttributeError(f"module 'strainsight.api' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__


Config = TypeVar("Config", PlacementConfig, BenchConfig)


@dataclass(frozen=True)
class _Checked(Generic[Config]):
    config: Config
    files: Mapping[str, Path]
    progress: Callable[[str, float], None] = silent
    sweep: Sweep = serial
    notice: Callable[[str], None] = lambda text: None
    base: Path = Path()


@dataclass(frozen=True)
class Case(_Checked[PlacementConfig]):
    """A placement as its config states it.

    config: the checked config; files: dotted key ("mesh.file") → input file; progress: called with what is being done and
    the share that is done; sweep: runs one function at many points, in one process unless another is given; notice: called with
    a sentence that need not wait for the result; base: the folder that paths of the config start from."""


@dataclass(frozen=True)
class BenchCase(_Checked[BenchConfig]):
    """A bench as its config states it; fields as of `Case`. Each method computes what the stage of that name writes."""

    def meshes(self) -> dict[str, Mesh]:
        """Flexible body → its mesh, checked, in SI units and to scale. Raises DeckError with file:line."""
        from strainsight.stages.bench.import_bodies import run_import

        context = Context(self.config, {}, self.files, self.progress, self.sweep, self.notice, self.base)
        return read(Meshes, InMemory(run_import(context).datasets)).bodies

    def reduce(self, meshes: Mapping[str, Mesh]) -> dict[str, ReducedBody]:
        """Flexible body → its modes and static shapes after Craig and Bampton."""
        from strainsight.experiment.bench.reduction import reduce_output

        return read(ReducedBodies, InMemory(reduce_output(self.config, meshes, self).datasets)).bodies

    def place(self, meshes: Mapping[str, Mesh], bodies: Mapping[str, ReducedBody]) -> BenchPlaced:
        """Layout of the section `place`, with an optimality bound and random layouts.
        Raises InfeasibleError if no permitted layout can observe every unknown in every pose."""
        from strainsight.experiment.bench.layout.placement import placement_output

        self._has("place")
        return read(BenchPlaced, InMemory(placement_output(self.config, meshes, bodies, self).datasets))

    def simulate(
        self, meshes: Mapping[str, Mesh], bodies: Mapping[str, ReducedBody], placed: BenchPlaced | None = None
    ) -> Simulated:
        """The bench in time. placed: a layout, where a sensor takes its gauges from one."""
        from strainsight.experiment.bench.bench import bench_of
        from strainsight.experiment.bench.simulation import simulate_output

        bench = bench_of(self.config, bodies, meshes, placed)
        return read(Simulated, InMemory(simulate_output(bench, self).datasets))

    def estimate(
        self,
        meshes: Mapping[str, Mesh],
        bodies: Mapping[str, ReducedBody],
        placed: BenchPlaced | None = None,
        measured: Simulated | None = None,
    ) -> BenchEstimated:
        """Loads and parameters of the section `estimate`, with σ NaN if it is omitted. measured: the motion of
        `estimate.measured.from`, if the config uses one."""
        from strainsight.experiment.bench.bench import bench_of
        from strainsight.experiment.bench.inverse.consistency import estimate_output
        from strainsight.experiment.bench.inverse.estimation import estimate_bench
        from strainsight.experiment.bench.inverse.problem import free_properties
        from strainsight.experiment.bench.inverse.truth import truths_of

        self._has("estimate")
        settings = self.config.estimate
        assert settings is not None
        truths = None
        if settings.truth.model == "independent" and settings.measured is None:
            duration = settings.truth.duration or self.config.filter_duration
            truths = truths_of(bench_of(self.config, bodies, meshes, placed), settings.truth, duration, self)
        bench = bench_of(self.config, bodies, meshes, placed, free_properties(settings))
        output = estimate_output(self.config, estimate_bench(bench, measured, truths, self))
        return read(BenchEstimated, InMemory(output.datasets))

    def _has(self, section: str) -> None:
        if getattr(self.config, section) is None:
            raise ConfigError(
                f"the config has no section '{section}'", key=section, remedy=f"add the section `{section}`"
            )


def load(path: Path | str, overrides: Iterable[str] = ()) -> Case:
    """Read and check the config of a placement; overrides as behind --set ("place.keep=6").

    Raises ConfigError that lists every problem with file:line:column, key and remedy."""
    from strainsight.stages.placement import stages_for

    config, job = _checked(path, overrides, PlacementConfig)
    test = config.estimate
    truth = None if config.validation is None else config.validation.truth.model
    stages = stages_for(test is not None and bool(test.file or test.records), truth)
    return Case(config, _files(stages, job), base=job.base)


def bench(path: Path | str, overrides: Iterable[str] = ()) -> BenchCase:
    """Read and check the config of a bench; overrides and errors as of `load`."""
    from strainsight.stages.bench.pipeline import bench_stages

    config, job = _checked(path, overrides, BenchConfig)
    return BenchCase(config, _files(bench_stages(job.config), job), base=job.base)


def _checked(path: Path | str, overrides: Iterable[str], kind: type[Config]) -> tuple[Config, Job]:
    from strainsight.runner.plan import Job

    loaded = load_config(path, overrides)
    config = loaded.model
    if not isinstance(config, kind):
        word = "placement" if kind is PlacementConfig else "bench"
        raise ConfigError(
            f"a config of the kind {word} is required, but the config has the kind {config.kind}",
            where=str(path),
            key="kind",
            remedy=f"use a config with `kind: {word}`",
        )
    return config, Job(loaded.data, loaded.path.parent, Path("results"), loaded.locate, config)


def _files(stages: Iterable[Stage], job: Job) -> dict[str, Path]:
    from strainsight.runner.plan import inputs_of

    return {key: path for stage in stages for key, path in inputs_of(stage, job).files.items()}


def mesh(case: Case) -> Mesh:
    """The deck with what the config adds, checked, in SI units. Raises DeckError with file:line."""
    from strainsight.experiment.structure.mesh import checked, mesh_of

    mesh = mesh_of(case.config.mesh, case.files["mesh.file"], base=case.base)
    checked(mesh, case.config.mesh)
    return mesh


def modes(case: Case, mesh: Mesh) -> Modes:
    """Natural frequencies and shapes of the whole model at the guess."""
    from strainsight.experiment.structure.reduction import modes_of

    return modes_of(case.config, mesh, case)


def reduce(case: Case, mesh: Mesh, modes_at_guess: Modes | None = None) -> Reduced:
    """The model reduced to a few coordinates, affine in the parameters; its modes are found first where they are not given."""
    from strainsight.experiment.structure.reduction import reduced_of

    return reduced_of(case.config, mesh, modes(case, mesh) if modes_at_guess is None else modes_at_guess, case)


def train(case: Case, mesh: Mesh, reduced: Reduced) -> Training:
    """The training simulation, and what every candidate reads of it."""
    from strainsight.experiment.structure.training import trained

    return trained(case.config, mesh, reduced, case)[0]


def _structure(case: Case, mesh: Mesh, reduced: Reduced, training: Training) -> Structure:
    from strainsight.experiment.structure.structure import Structure

    return Structure(case.config, case.files, mesh, reduced, training)


def screen(case: Case, mesh: Mesh, reduced: Reduced, training: Training) -> Screened:
    """The clearance from edges, supports and loads, the noise of every channel, and which candidates go on."""
    from strainsight.experiment.structure.screening import screened_of

    return screened_of(_structure(case, mesh, reduced, training))


def observe(case: Case, reduced: Reduced, training: Training, screened: Screened) -> Observed:
    """Observability of loads, moduli and densities with the whole pool, for all cases and excitations."""
    from strainsight.experiment.structure.observation import observed_of

    return observed_of(case.config, reduced, training, screened, case)


def place(case: Case, mesh: Mesh, reduced: Reduced, training: Training, screened: Screened) -> StructurePlacement:
    """The layout, from elimination and exchanges, with an optimality bound and the predicted σ.

    `.gauges`: candidate numbers, by the effect of their removal, largest first; `.listed`: locations; `.expected.std`: σ of every
    unknown, relative to `.expected.reference`; `.hot_spots`: as in `hot_spots`; `.at_gauges`: strain gradient and free height;
    `.advice`: sentences. Raises InfeasibleError if no permitted layout can observe every unknown."""
    from strainsight.experiment.structure.placement import placement_of

    return placement_of(case.config, mesh, reduced, training, screened, case)


def expect(
    case: Case, mesh: Mesh, reduced: Reduced, training: Training, screened: Screened, gauges: Gauges
) -> Expectation:
    """Predicted σ of a filter with any gauges along the training simulation, under the configured loads.

    `.std`: σ of every unknown, relative to `.reference` (guess of a parameter, RMS of a load in training); `.absolute`: σ in SI;
    `.without`: `.std` without each gauge in turn; `.budget`: shares of the variance by source."""
    from strainsight.experiment.structure.considered import tolerated
    from strainsight.experiment.structure.expectation import expectation
    from strainsight.experiment.structure.problem import problem_of

    structure, numbers = _structure(case, mesh, reduced, training), np.asarray(gauges, dtype=int)
    problem = problem_of(structure, screened)
    return expectation(problem, numbers, tolerated(structure, problem.channels.of(numbers)))


def hot_spots(case: Case, mesh: Mesh, reduced: Reduced, training: Training, gauges: Gauges) -> HotSpots | None:
    """Mesh sensitivity of the strain at up to 20 gauges.

    `.refined`, `.spread`: changes relative to the RMS reading in training, with a refined local mesh and with distributed nodal
    forces; `.hot`: gauges above the limit `.share`. None for a model without mesh."""
    from strainsight.experiment.structure.clearance import tested_hot_spots

    return tested_hot_spots(_structure(case, mesh, reduced, training), np.asarray(gauges, dtype=int))


def validate(
    case: Case, mesh: Mesh, reduced: Reduced, training: Training, screened: Screened, gauges: Gauges
) -> Validation:
    """The filter on simulated measurements with model error.

    `.accuracy`: error and standard deviation of every unknown; `.validated`: histories and studies as in validate.h5."""
    from strainsight.experiment.structure.reduction import spectrum_of
    from strainsight.experiment.structure.validation import validation_of

    modal = case.config.validation.truth.model in ("modes", "perturbed")
    spectrum = spectrum_of(case.config, mesh, case) if modal else None
    numbers = np.asarray(gauges, dtype=int)
    return validation_of(_structure(case, mesh, reduced, training), spectrum, screened, numbers, case)


def estimate(
    case: Case, mesh: Mesh, reduced: Reduced, training: Training, screened: Screened, gauges: Gauges = ()
) -> Estimation:
    """The filter on the measurements of a test, `estimate.file` of the config.

    gauges: those named G1, G2, … in the config; none if all have names. `.estimated`: loads, parameters and strains with their σ
    as in estimate.h5; `.surface`: surface fields for `to_pyvista`. Raises UserError for inconsistent measurements, and
    InfeasibleError if the channels cannot distinguish the unknowns."""
    estimation = campaign(case, mesh, reduced, training, screened, gauges).only
    if estimation is None:
        raise ConfigError(
            "`estimate` of strainsight.api supports a single record, but the test has several",
            key="estimate.records",
            remedy="call `campaign` of strainsight.api instead; it returns the estimates of all records",
        )
    return estimation


def campaign(
    case: Case, mesh: Mesh, reduced: Reduced, training: Training, screened: Screened, gauges: Gauges = ()
) -> Campaign:
    """The filter on all records of a test, `estimate.records` of the config, in one estimate.

    `.records`: as `estimate`, by record name, with parameters common to all; `.damage`: of all records; `.together`: parameters
    from each record alone. Arguments and errors as in `estimate`."""
    from strainsight.experiment.structure.campaign import campaign_of

    return campaign_of(case.config, mesh, reduced, training, screened, np.asarray(gauges, dtype=int), case)
