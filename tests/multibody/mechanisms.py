"""What planar mechanisms are made of, and the limit of a sequence of runs."""

from itertools import pairwise

import numpy as np

from strainsight.multibody.bodies import Frame, RigidBody


def extrapolated(values, order):
    """The limit for h → 0 of values at h, h/2, h/4, …, their error a power series in h that begins with hᵒʳᵈᵉʳ."""
    table = list(values)
    for k in range(order, order + len(table) - 1):
        table = [(2**k * fine - coarse) / (2**k - 1) for coarse, fine in pairwise(table)]
    return table[0]


def differences(function, x, size):
    """Fourth-order central differences, column by column."""
    columns = []
    for unit in np.eye(len(x)):
        near = function(x + size * unit) - function(x - size * unit)
        far = function(x + 2 * size * unit) - function(x - 2 * size * unit)
        columns.append((8 * near - far) / (12 * size))
    return np.stack(columns, axis=1)


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def at(name, body, x=0.0, y=0.0):
    return Frame(name, body, np.array([x, y, 0.0]))


def planar(name, mass, centre, inertia):
    """A body in the plane z = 0 with the moment of inertia about its centre, a thin disc's in the other directions."""
    centre = np.array([*centre, 0.0])
    central = np.diag([inertia / 2, inertia / 2, inertia])
    return RigidBody(name, mass, centre, central + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre)))
