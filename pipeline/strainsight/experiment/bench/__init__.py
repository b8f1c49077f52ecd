"""Bench model: bodies, joints, forces, sensors, loads, initial state."""
