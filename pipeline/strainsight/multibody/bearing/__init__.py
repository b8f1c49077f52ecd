"""The four-point-contact ball bearing as a nonlinear force element between two rings."""
