"""The part: posed for the printer, and written as STL and 3MF."""
