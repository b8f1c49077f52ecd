"""Factorisation, modes and static responses distributed over MPI processes: PETSc, SLEPc and MUMPS in a separate interpreter."""
