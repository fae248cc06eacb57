"""The printed part: posed on the bed, and written as STL and 3MF."""
