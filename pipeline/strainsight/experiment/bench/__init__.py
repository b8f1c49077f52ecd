"""What a bench is made of: bodies, joints, forces, sensors, loads, its start."""
