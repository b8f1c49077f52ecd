"""Finite elements: affine stiffness and mass, constraints, factorisation, modes."""
