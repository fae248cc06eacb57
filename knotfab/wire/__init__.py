"""Wire instead of print: a bending plan, its replay, and templates at full size."""
