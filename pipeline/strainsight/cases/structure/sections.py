"""Sections of shells, beams and rods that a config states."""

from __future__ import annotations

from itertools import product

import numpy as np

from strainsight.config.mesh import ElementSection, MeshFile
from strainsight.mesh.given_sections import GivenSection
from strainsight.mesh.thin import BeamSection, ShellSection


def given_sections(config: MeshFile, key: str = "mesh") -> dict[str, GivenSection]:
    """Key → section, of the config's section at `key`."""
    return {f"{key}.sections.{name}": _given(own) for name, own in config.sections.items()}


def _given(own: ElementSection) -> GivenSection:
    regions = None if own.regions == "all" else own.regions
    if own.thickness is not None:
        return GivenSection(regions, ShellSection(own.thickness), own.offset)
    yy, zz, yz = (*(own.second_moments or (0.0, 0.0)), 0.0)[:3]
    half = [(-0.5 * side, 0.5 * side) for side in own.size or ()]
    section = BeamSection(
        float(own.area or 0.0),  # the config asks for one of the two
        np.array([[yy, yz], [yz, zz]]),
        own.torsion or 0.0,
        points=np.array(list(product(*half)) if half else np.zeros((0, 2))),
    )
    return GivenSection(regions, section, direction=own.direction)
