"""Configs: frozen models, YAML with line numbers, overrides, JSON Schema, template. Knows no kernel."""
