"""Arrays in, figures and a page out: reads no artefact, knows no kernel."""
