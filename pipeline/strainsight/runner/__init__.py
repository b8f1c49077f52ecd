"""Stages, artefacts and the runner that keeps them up to date. Knows no kernel and no config model."""
