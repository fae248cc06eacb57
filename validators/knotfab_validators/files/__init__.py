"""Readers of the files to check; each refuses a bad file in one sentence."""
