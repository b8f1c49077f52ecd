"""The step in minimal coordinates, as compiled code: six motions of every body that moves, its modes, and the joints."""
