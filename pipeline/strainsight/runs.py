"""Results of runs on the command line, stage by stage, as records of NumPy arrays."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Generic

import numpy as np

from strainsight.errors import UserError
from strainsight.mesh.model import Mesh
from strainsight.mesh.vtkhdf import VtkHdf, unstructured_grid
from strainsight.records.bearing import BearingResults
from strainsight.records.bench import BenchEstimated, ReducedBodies, ReducedBody, Simulated, SurfaceHistory
from strainsight.records.bench_placed import BenchPlaced
from strainsight.records.estimated import CampaignRecord, Estimated, campaign_in, estimated_in
from strainsight.records.mesh import Meshes, mesh_from
from strainsight.records.placed import Observed, Placed
from strainsight.records.record import Record, read
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.training import Screened, Training
from strainsight.records.validated import Validated
from strainsight.runner.artefact import Artefact

if TYPE_CHECKING:
    import pyvista


@dataclass(frozen=True)
class Written:
    """The artefacts of a run; each array is read on first access.

    folder: results/NAME. Raises ArtefactError for a stage that has not run, and for a damaged file."""

    GRIDS: ClassVar[str]
    """Stages with a grid."""
    folder: Path

    def artefact(self, stage: str) -> Artefact:
        """The artefact of a stage: `.summary`, `.tables`, `.message`, and its datasets by path."""
        return Artefact(self.folder / f"{stage}.h5")

    def to_pyvista(self, stage: str = "import", step: int = 0) -> pyvista.UnstructuredGrid:
        """The grid of a stage at one of its steps."""
        artefact = self.artefact(stage)
        if "/VTKHDF" not in artefact:
            raise UserError(
                f"the results file of the stage '{stage}' contains no mesh (group /VTKHDF)",
                where=str(artefact.path),
                remedy=self.GRIDS,
            )
        paths = [path for path in artefact.paths() if path.startswith("/VTKHDF/")]
        return to_pyvista(VtkHdf({path.removeprefix("/VTKHDF/"): artefact[path] for path in paths}, {}), step)


class _Of(Generic[Record]):
    """Property for the record of a stage in `Written`, read on access."""

    def __init__(self, kind: type[Record], stage: str) -> None:
        self.kind, self.stage = kind, stage

    def __get__(self, written: Written | None, owner: type) -> Record:
        return self if written is None else read(self.kind, written.artefact(self.stage))  # type: ignore[return-value]


class Run(Written):
    """Results of a placement. Grids: "import" the mesh, "rom" the modes as steps, "place" the pool, "validate" the strain of the
    candidates, "estimate" with `estimate.field` the surface over time."""

    GRIDS = "use stage='import', 'rom', 'place' or 'validate'; or set `estimate.field` in the config and use stage='estimate'"

    @property
    def mesh(self) -> Mesh:
        return mesh_from(self.artefact("import"))

    modes = _Of(Modes, "modes")
    reduced = _Of(Reduced, "rom")
    training = _Of(Training, "train")
    screened = _Of(Screened, "screen")
    observed = _Of(Observed, "observe")
    placed = _Of(Placed, "place")
    validated = _Of(Validated, "validate")

    @property
    def estimated(self) -> Estimated:
        """The estimate of a test with one record. Raises UserError for several records."""
        artefact = self.artefact("estimate")
        if campaign_in(artefact) is not None:
            raise UserError(
                "`estimated` supports a single record, but the test has several",
                where=str(artefact.path),
                remedy="use the attribute `records`, a dict from the name of a record to its estimate",
            )
        return read(Estimated, artefact)

    @property
    def records(self) -> dict[str, Estimated]:
        """The records of a test by name; a single record has an empty name."""
        return estimated_in(self.artefact("estimate"))

    @property
    def campaign(self) -> CampaignRecord | None:
        """Results common to several records; None for one record."""
        return campaign_in(self.artefact("estimate"))


class BenchRun(Written):
    """Results of a bench, or of bearings alone. Grids: "place" the pool, "field" the surface of a body over time."""

    GRIDS = "use stage='place' or stage='field'; the config must have a section of this name"

    @property
    def meshes(self) -> dict[str, Mesh]:
        return read(Meshes, self.artefact("import")).bodies

    @property
    def reduced(self) -> dict[str, ReducedBody]:
        return read(ReducedBodies, self.artefact("reduce")).bodies

    bearings = _Of(BearingResults, "bearing")
    placed = _Of(BenchPlaced, "place")
    simulated = _Of(Simulated, "simulate")
    estimated = _Of(BenchEstimated, "estimate")
    surface = _Of(SurfaceHistory, "field")


def open_run(folder: Path | str) -> Run:
    """Results of a placement in `results/NAME`. Raises UserError if the folder has no results."""
    return Run(_results(folder))


def open_bench(folder: Path | str) -> BenchRun:
    """Results of a bench, or of bearings alone, in `results/NAME`. Raises UserError if the folder has no results."""
    return BenchRun(_results(folder))


def to_pyvista(grid: VtkHdf | Mesh, step: int = 0) -> pyvista.UnstructuredGrid:
    """A mesh, or a grid at one of its steps."""
    from pyvista import UnstructuredGrid

    surface = unstructured_grid(grid.position, grid.elements) if isinstance(grid, Mesh) else grid
    offset, points = surface.datasets["Offsets"], surface.datasets["Points"]
    cells = np.insert(surface.datasets["Connectivity"], offset[:-1], np.diff(offset))
    result = UnstructuredGrid(cells, surface.datasets["Types"], points)
    for path, values in surface.datasets.items():
        where, _, name = path.partition("/")
        if where in ("PointData", "CellData"):
            data, size = (
                (result.point_data, len(points)) if where == "PointData" else (result.cell_data, len(offset) - 1)
            )
            data[name] = values[step * size :][:size] if len(values) > size else values
    return result


def _results(folder: Path | str) -> Path:
    path = Path(folder)
    if not any(path.glob("*.h5")):
        raise UserError(
            "the folder contains no results of a run",
            where=str(path),
            remedy="specify the folder results/NAME of a run",
        )
    return path
