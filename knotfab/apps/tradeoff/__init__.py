"""What accuracy costs in time, measured on this machine."""
