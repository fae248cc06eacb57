"""Check that a printer can make a part, whole or on plates."""
