"""A structure with its config, mesh, reduced model and training simulation."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import Tolerances, tolerances_of
from strainsight.errors import DeckError
from strainsight.experiment.structure.candidates import free_thicknesses, thickness_at
from strainsight.experiment.structure.training import TrainingRun, runs_of
from strainsight.experiment.system import installation_std
from strainsight.fem.affine import Parameter
from strainsight.fem.mass import mass_properties
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import Thickness
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training, with_missed
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.installation import InstallationStd, Sensitivity, given_sensitivity, sensitivity_rows
from strainsight.sensors.surface_paths import Skin, skin_of


@dataclass(frozen=True)
class Structure:
    """config; files: paths by config key; mesh; reduced model; training simulation."""

    config: PlacementConfig
    files: Mapping[str, Path]
    mesh: Mesh
    reduced: Reduced
    training: Training

    @property
    def pool(self) -> Candidates:
        """All candidates."""
        return self.training.candidates

    @property
    def tolerances(self) -> Tolerances:
        """Tolerances of the config."""
        return tolerances_of(self.config.tolerances)

    @property
    def installation(self) -> InstallationStd:
        """σ of gauge installation."""
        return installation_std(self.tolerances)

    @cached_property
    def mass(self) -> float:
        """Mass of the mesh [kg]; 0 if densities are missing."""
        with suppress(DeckError):
            return mass_properties(self.mesh)[0]
        return 0.0

    @cached_property
    def runs(self) -> tuple[TrainingRun, ...]:
        """Training runs, one per load case."""
        return runs_of(self.config, self.reduced.model.inputs, self.files)

    @cached_property
    def skin(self) -> Skin:
        """Surface of the mesh."""
        return skin_of(self.mesh.position, exterior_facets(self.mesh))

    @cached_property
    def field(self) -> np.ndarray:
        """Displacement (3 nodes, r) per coordinate, with the static residual of misaligned loads appended."""
        return with_missed(self.reduced.basis, self.reduced.misaligned.missed)

    @cached_property
    def free_thicknesses(self) -> tuple[Parameter, ...]:
        """Estimated shell thicknesses."""
        return free_thicknesses(self.config, self.mesh, self.reduced.model.reference)

    @cached_property
    def thickness(self) -> Thickness | None:
        """Shell thickness at the guess, None if no thickness is estimated."""
        return thickness_at(self.mesh, self.free_thicknesses, self.reduced.model.reference)

    def sensitivity(self, channels: np.ndarray) -> Sensitivity:
        """Sensitivity of channels to installation errors, per column of `field`."""
        training = self.training
        if training.strain_operator is not None:
            return given_sensitivity(with_missed(training.rows[channels], training.missed[channels]))
        std, part = self.installation.position, self.pool.take(channels)
        return sensitivity_rows(
            self.mesh.position,
            part,
            self.field,
            std,
            facets=self.skin,
            thickness=self.thickness,
            mesh=self.installation.mesh > 0,
        )
