"""Who factorises the stiffness of the whole model, as the config asks."""

from __future__ import annotations

from strainsight.cases.resources import Resources
from strainsight.config.placement import PlacementConfig
from strainsight.fem.factorisation import Factorise, factorise
from strainsight.fem.mpi.session import OverMpi
from strainsight.sweep.sweep import Sweep, serial


def solver_of(config: PlacementConfig, using: Resources) -> Factorise:
    """PARDISO here, or MUMPS in the processes of MPI."""
    return factorise if config.solver == "direct" else OverMpi(using.notice)


def sweep_of(config: PlacementConfig, using: Resources) -> Sweep:
    """Of samples that are factorised each: one after the other, where every one of them has the processes of MPI."""
    return using.sweep if config.solver == "direct" else serial
