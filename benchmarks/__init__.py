"""Studies that measure what README and docs claim: each is run as `python -m benchmarks.NAME`."""
