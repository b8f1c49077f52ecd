"""What the estimate of a bench is made of: unknowns, truth, filter, comparison."""
