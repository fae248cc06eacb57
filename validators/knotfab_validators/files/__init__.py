"""Readers of what is given, each refusing a bad file with one sentence."""
