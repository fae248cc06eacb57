"""Independent checks: written files are read from disk and measured anew."""
