"""Effects: simulated only when they matter. Each module is one effect."""
