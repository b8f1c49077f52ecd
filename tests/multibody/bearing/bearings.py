"""Bearings that the tests share."""

from __future__ import annotations

import numpy as np

from strainsight.multibody.bearing.geometry import Bearing


def angular_contact_218(**more) -> Bearing:
    """The 218 angular-contact bearing of Harris, Rolling Bearing Analysis: two of the four contacts of each ball carry.

    16 balls of 22.23 mm on 125.3 mm, grooves of 0.5232 D on both rings, free contact angle 40°; steel of 208 GPa, ν = 0.3.
    """
    r = 0.5232 * 0.02223
    return Bearing(16, 0.1253, np.radians(40), 0.02223, r, r, r, r, youngs_modulus=2.08e11, **more)


def pitch_bearing(balls: int = 112, **more) -> Bearing:
    """Blade bearing of a 3 MW bench: 112 balls of 60 mm on 2.3 m, grooves of 0.53 D, 45°."""
    r = 0.53 * 0.06
    return Bearing(balls, 2.3, np.radians(45), 0.06, r, r, r, r, **more)


def uneven(**more) -> Bearing:
    """Seven balls, four different grooves: nothing cancels by symmetry."""
    return Bearing(7, 0.5, 0.75, 0.06, 0.0313, 0.0315, 0.0318, 0.0317, first_ball=0.2, **more)
