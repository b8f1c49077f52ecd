"""The config of `kind: bench` and `kind: bearing`: bodies, joints, forces, sensors of a multibody bench."""
