"""Readers of given files, each refusing a bad file with one sentence."""
