"""Which gauges to keep: steady covariance, elimination, exchange, certificate, baselines."""
