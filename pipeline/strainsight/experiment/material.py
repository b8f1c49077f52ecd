"""Damping laws and regions of material that a config states."""

from __future__ import annotations

from strainsight.config.mesh import RegionKey
from strainsight.config.placement import ModalDamping, RayleighDamping
from strainsight.rom.model import Damping


def damping_of(config: ModalDamping | RayleighDamping) -> Damping:
    """The damping law."""
    if config.type == "modal":
        return Damping("modal", ratio=config.ratio)
    return Damping("rayleigh", alpha=config.alpha, beta=config.beta)


def named_regions(region: RegionKey | tuple[RegionKey, ...] | None) -> tuple[RegionKey, ...]:
    """The regions that a config names, which may be one."""
    if region is None:
        return ()
    return region if isinstance(region, tuple) else (region,)
