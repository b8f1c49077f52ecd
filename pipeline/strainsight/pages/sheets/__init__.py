"""Drawing sheets of the gauges of a layout."""
