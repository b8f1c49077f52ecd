"""Records and arrays in, figures and a page out: decides nothing, and of the kernels knows only the words of verdicts."""
