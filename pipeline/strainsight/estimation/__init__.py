"""From measured strains to loads, parameters and strain field: augmented Kalman filter, smoother, consistency."""
