"""One file a stage: read the artefacts, call the kernels, return the arrays with their units; `placement` is their tuple."""
