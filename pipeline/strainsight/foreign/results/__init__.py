"""Results of another program, its modes and static responses, one after the other."""
