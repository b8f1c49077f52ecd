"""Factorisation, modes and static responses over the processes of MPI: PETSc, SLEPc and MUMPS, in an interpreter of their own."""
