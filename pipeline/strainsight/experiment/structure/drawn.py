"""What a rich truth draws from the tolerances: how gauges are installed, how loads act, damping and frequency of its modes, how
stiff it is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.fem.affine import of_stiffness
from strainsight.mesh.properties import SECTION_FACTORS, THICKNESS
from strainsight.rom.model import ReducedModel, first_of_equal, modal_basis
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.installation import Installation, InstallationStd, drawn_installation

INSTALLATION, MODEL, LOADS = 1, 2, 3
"""Streams of the random numbers of gauges, of the model and of loads, apart from those of the noise."""
BY_MODE = 0.5
"""σ of the natural frequency of one mode beside the others, over that of all alike."""


@dataclass(frozen=True)
class LoadError:
    """How a load really acts: turn (2,) [rad] about and shift (2,) [m] along two axes across it; factor [-] on the force that is
    known of it."""

    turn: np.ndarray
    shift: np.ndarray
    factor: float


def installation_std(config: PlacementConfig) -> InstallationStd:
    """σ of how gauges are installed, in SI units and rad."""
    own = tolerances_of(config.tolerances)
    return InstallationStd(
        own.position,
        float(np.deg2rad(own.angle)),
        own.gain,
        own.transverse,
        own.offset,
        own.drift,
        own.temperature,
        own.thermal_output,
        own.thermal_spread,
    )


def installation_of(config: PlacementConfig, pool: Candidates, realisation: int) -> Installation:
    """Draw number `realisation` of the config's seed, 0 that of the layout's own measurement.

    A place or direction that `validate.truth` states has that size, in a direction that is drawn once for all realisations.
    """
    stated = config.validation.truth
    rng = np.random.default_rng([config.seed, realisation, INSTALLATION])
    found = drawn_installation(pool, installation_std(config), rng)
    fixed = np.random.default_rng(config.seed)
    grids = pool.grids
    heading, way = fixed.uniform(0, 2 * np.pi, grids.gauges), fixed.choice([-1.0, 1.0], grids.gauges)
    free = ~grids.bonded[grids.first]
    if stated.gauge_offset is not None:
        ahead = np.column_stack([np.cos(heading), np.sin(heading)])
        found = replace(found, place=stated.gauge_offset * ahead * free[:, None])
    if stated.gauge_rotation is not None:
        turn = np.deg2rad(stated.gauge_rotation) * way * free
        found = replace(found, angle=turn, tilt=np.zeros_like(found.tilt))
    return found


def load_error_of(config: PlacementConfig, name: str, known: bool, realisation: int) -> LoadError:
    """Of one load, which the others do not change: its name has a stream of its own. Only a known load has a gain."""
    own = tolerances_of(config.tolerances)
    rng = np.random.default_rng([config.seed, realisation, LOADS, crc32(name.encode())])
    turn, shift, gain = rng.standard_normal(2), rng.standard_normal(2), rng.standard_normal()
    return LoadError(
        np.deg2rad(own.load_angle) * turn, own.load_position * shift, 1.0 + (own.load_gain * gain if known else 0.0)
    )


def loads_vary(config: PlacementConfig) -> bool:
    """Whether some load acts otherwise than it should."""
    return misaligned_loads(config) or (_some_known(config) and tolerances_of(config.tolerances).load_gain > 0)


def _some_known(config: PlacementConfig) -> bool:
    return any(name not in config.place.estimate for name in config.loads)


def misaligned_loads(config: PlacementConfig) -> bool:
    """Whether their direction or point is not exact."""
    own = tolerances_of(config.tolerances)
    return own.load_angle > 0 or own.load_position > 0


def model_of(config: PlacementConfig, model: ReducedModel, realisation: int) -> ReducedModel:
    """The model with drawn damping, ζᵢ = ζ exp(sᵢ ln f) with a normal sᵢ for every mode, drawn natural frequencies,
    ωᵢ = ω exp(σ (s + sᵢ BY_MODE)) by the mass of every mode, and one drawn scale of the stiffness, K exp(s σ).

    A `damping_factor` that `validate.truth` states holds for every mode and realisation. The stiffness keeps its scale where a
    modulus is estimated.
    """
    own, stated = tolerances_of(config.tolerances), config.validation.truth.damping_factor
    rng = np.random.default_rng([config.seed, realisation, MODEL])
    scale = np.exp(own.model * rng.standard_normal())
    factors = np.exp(np.log(own.damping) * rng.standard_normal(model.size))
    common, by_mode = rng.standard_normal(), rng.standard_normal(model.size)
    if stated is not None:
        model = replace(model, damping=model.damping.scaled(stated))
    elif own.damping > 1:
        model = replace(model, damping=model.damping.scaled(factors.tolist()))
    if own.frequency > 0:
        # the coordinates are the modes
        same = first_of_equal(modal_basis(model, model.reference)[0])
        f = np.exp(own.frequency * (common + BY_MODE * by_mode[same]))
        model = replace(model, mass=model.mass.of_all(lambda X: X / np.outer(f, f)))
    if own.model > 0 and not modulus_estimated(config):
        model = replace(model, stiffness=model.stiffness.of_all(lambda X: scale * X))
    return model


def _sources(config: PlacementConfig, given: bool) -> list[str]:
    """What is drawn with which σ; given: whether the gauges are given by their strain rows, which cannot be moved or turned."""
    own, stated = tolerances_of(config.tolerances), config.validation.truth
    moved = not given
    sizes = (
        (own.damping - 1, f"ln ζ of every mode ln {own.damping:g}", stated.damping_factor is None),
        (own.frequency, f"natural frequencies {100 * own.frequency:g} %", True),
        (own.model, f"stiffness {100 * own.model:g} %", not modulus_estimated(config)),
        (own.position, f"place {1e3 * own.position:g} mm each way", moved and stated.gauge_offset is None),
        (own.angle, f"direction {own.angle:g}°", moved and stated.gauge_rotation is None),
        (own.gain, f"gain {100 * own.gain:g} %", True),
        (own.transverse, f"transverse sensitivity {100 * own.transverse:g} %", moved),
        (own.offset, f"offset {1e6 * own.offset:g} µm/m", True),
        (own.drift, f"drift {1e6 * own.drift:g} µm/m", True),
        (own.temperature, f"temperature {own.temperature:g} K", any(installation_std(config).warmed)),
        (own.load_angle, f"direction of loads {own.load_angle:g}°", True),
        (own.load_position, f"point of loads {1e3 * own.load_position:g} mm", True),
        (own.load_gain, f"gain of known loads {100 * own.load_gain:g} %", _some_known(config)),
    )
    return [words for size, words, applies in sizes if size > 0 and applies]


def varies(config: PlacementConfig) -> bool:
    """Whether one realisation differs from another."""
    return bool(_sources(config, given=False))


def in_words(config: PlacementConfig, given: bool) -> str:
    """What is off, for people; given: as of `_sources`. Begins with a comma."""
    stated, fixed = config.validation.truth, []
    if stated.damping_factor is not None:
        fixed.append(f"damping × {stated.damping_factor:g}")
    if given:
        fixed.append("gauges exactly in place, because given strain rows cannot be moved or turned")
    elif stated.gauge_offset is not None or stated.gauge_rotation is not None:
        sizes = ((stated.gauge_offset, 1e3, " mm"), (stated.gauge_rotation, 1.0, "°"))
        parts = (f"{factor * size:g}{unit}" for size, factor, unit in sizes if size is not None)
        fixed.append(f"gauges off by {' and '.join(parts)}")
    drawn = _sources(config, given)
    words = fixed + ([f"drawn with σ: {', '.join(drawn)}"] if drawn else [])
    return "".join(f", {text}" for text in words)


def modulus_estimated(config: PlacementConfig) -> bool:
    """Whether some modulus or factor of the stiffness is among the unknowns, so that one scale of the stiffness is; a factor of
    springs, or of the section of beams, is none, and no thickness."""
    named = [config.parameters[name] for name in config.place.estimate if name in config.parameters]
    of_whole = [
        own for own in named if of_stiffness(own.property) and own.property not in (*SECTION_FACTORS, THICKNESS)
    ]
    return any(own.springs is None for own in of_whole)
