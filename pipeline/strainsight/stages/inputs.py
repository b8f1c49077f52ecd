"""What the stages of a placement read from the artefacts above them."""

from __future__ import annotations

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.structure import Structure
from strainsight.mesh.model import Mesh
from strainsight.records.mesh import mesh_from
from strainsight.records.placed import Placed
from strainsight.records.record import read
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.training import Screened, Training
from strainsight.runner.stage import Context


def mesh(context: Context[object]) -> Mesh:
    """The mesh of import.h5."""
    return mesh_from(context.upstream["import"])


def reduced(context: Context[object]) -> Reduced:
    """rom.h5."""
    return read(Reduced, context.upstream["rom"])


def training(context: Context[object]) -> Training:
    """train.h5."""
    return read(Training, context.upstream["train"])


def structure(context: Context[PlacementConfig]) -> Structure:
    """Of import.h5, rom.h5 and train.h5."""
    return Structure(context.config, context.files, mesh(context), reduced(context), training(context))


def screened(context: Context[object]) -> Screened:
    """screen.h5."""
    return read(Screened, context.upstream["screen"])


def layout(context: Context[object]) -> np.ndarray:
    """Numbers of the gauges of place.h5, G1 first."""
    return read(Placed, context.upstream["place"]).final.number


def spectrum(context: Context[object]) -> Modes | None:
    """spectrum.h5, which only a truth that is made of modes has."""
    spectrum = context.upstream.get("spectrum")
    return None if spectrum is None else read(Modes, spectrum)
