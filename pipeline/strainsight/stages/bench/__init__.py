"""Stages of a multibody bench and of a bearing alone."""
