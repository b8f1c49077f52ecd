"""Augmented systems: unknown inputs and parameters as states, their noise, what they can be observed from."""
