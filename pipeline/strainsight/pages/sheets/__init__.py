"""A drawing sheet for every gauge of a layout."""
