"""Common parts of pages: document, markup, formatted numbers."""
