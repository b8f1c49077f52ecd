"""The strainsight command line: parses, renders, exits; no numerics."""
