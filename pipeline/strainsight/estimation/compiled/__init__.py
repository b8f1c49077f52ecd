"""Linear Kalman filters side by side, as compiled loops; `parallel_filters.advance` has the equations."""
