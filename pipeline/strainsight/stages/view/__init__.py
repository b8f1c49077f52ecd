"""What `strainsight view` shows, read from the artefacts of a run."""
