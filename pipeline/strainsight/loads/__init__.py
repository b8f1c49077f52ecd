"""Load histories, models of unknown inputs, and the augmented state."""
