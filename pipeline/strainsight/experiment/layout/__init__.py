"""From a pool of gauges and a linear problem to a layout with its proof: the same for a structure and for a bench."""
