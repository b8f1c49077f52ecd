"""Rigid and flexible bodies, joints and force elements: the bench model of the thesis (1.1-1.25) and its implicit step."""
