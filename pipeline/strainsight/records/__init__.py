"""Dataclasses as datasets of an artefact, and back."""
