"""Examples and measurements: each is run as `python -m examples.NAME`."""
