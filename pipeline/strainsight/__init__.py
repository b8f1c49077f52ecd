"""strainsight: where to bond strain gauges, what they will let you know, and how well."""

__version__ = "0.1.0"
