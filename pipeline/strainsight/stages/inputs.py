"""What the stages of a placement read from the artefacts above them."""

from __future__ import annotations

from strainsight.cases.structure.problem import Problem, problem_of
from strainsight.mesh.model import Mesh
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.workflow.stage import Context


def mesh(context: Context) -> Mesh:
    """The mesh of import.h5."""
    return mesh_from(context.upstream["import"])


def reduced(context: Context) -> Reduced:
    """rom.h5."""
    return read(Reduced, context.upstream["rom"])


def training(context: Context) -> Training:
    """train.h5."""
    return read(Training, context.upstream["train"])


def screened(context: Context) -> Screened:
    """screen.h5."""
    return read(Screened, context.upstream["screen"])


def problem(context: Context) -> Problem:
    """The estimation problem of the config, from rom, train and screen."""
    return problem_of(context.config, context.files, reduced(context), training(context), screened(context))
