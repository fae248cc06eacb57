"""The jobs of the command line as tools for programs."""
