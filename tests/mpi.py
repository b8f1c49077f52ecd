"""Whether SLEPc is here, and the environment in which it runs on this machine."""

from __future__ import annotations

import os

import pytest

from strainsight.contrib.mpi.session import programs
from strainsight.errors import UserError

ALLOWED = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
}
"""Root, as in a container, and more processes than cores: Open MPI 4 and 5."""


def lacking() -> str:
    """Why no processes of MPI can be had here, "" where they can."""
    try:
        programs()
    except UserError as error:
        return error.what
    return ""


needs_slepc = pytest.mark.skipif(bool(lacking()), reason=f"SLEPc is not installed ({lacking()})")


def over(processes: int) -> dict[str, str]:
    """The environment for so many processes."""
    return {**os.environ, **ALLOWED, "STRAINSIGHT_MPI": f"mpiexec -n {processes}"}
