"""Short scripts to read and run: `python -m examples.NAME`."""
