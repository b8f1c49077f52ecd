"""Picture of the structure with its gauges, rendered off-screen in a child process."""
