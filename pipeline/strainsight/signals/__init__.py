"""Load and training histories, and how a time step holds them."""
