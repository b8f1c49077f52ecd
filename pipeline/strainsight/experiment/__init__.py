"""The policies of a run, as functions of config models and arrays: what to estimate, with which noise, from which gauges."""
