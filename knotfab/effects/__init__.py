"""Physical effects, simulated only where they matter; each module holds one or more."""
