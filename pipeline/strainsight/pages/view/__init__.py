"""What `strainsight view` shows, in a window or as a picture."""
