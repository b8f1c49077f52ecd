"""Pictures and windows of `strainsight view`."""
