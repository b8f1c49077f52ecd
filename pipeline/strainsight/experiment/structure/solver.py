"""Who factorises the stiffness of the whole model, as the config asks."""

from __future__ import annotations

from strainsight.config.placement import PlacementConfig
from strainsight.contrib.mpi.session import OverMpi
from strainsight.experiment.resources import Resources
from strainsight.fem.factorisation import Factorise, factorise
from strainsight.memory import available_memory
from strainsight.parallel.sweep import Sweep, in_threads, serial, threads
from strainsight.processes import peak_memory


def solver_of(config: PlacementConfig, using: Resources) -> Factorise:
    """PARDISO here, or MUMPS in the processes of MPI."""
    return factorise if config.solver == "direct" else OverMpi(using.notice)


def sweep_of(config: PlacementConfig, using: Resources) -> Sweep:
    """Of samples that are factorised each: in threads, as the solver is compiled and a model is large to send; on a cluster where
    there is one; one after the other where every one of them has the processes of MPI."""
    if config.solver != "direct":
        return serial
    return in_threads(_fitting) if threads() > 1 else using.sweep


def _fitting() -> int:
    """How many at a time: of each as much beside what there is as this process has held at most, a factor included, as the
    reference is factorised before a sweep begins."""
    return min(threads(), max(1, int(available_memory() / (peak_memory() or 1))))
