"""The structure with its gauges as a still picture, drawn off-screen in a process of its own."""
