"""What a run is about, in the terms of the kernels: settings, the estimation problem, the truth, the trials on it."""
