"""The parametric reduced model: basis, projection, damping, exact time step."""
