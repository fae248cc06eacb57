"""What reproduces and extends *Search Me Knot, Render Me Knot*: each is run as `python -m paper.NAME`."""
