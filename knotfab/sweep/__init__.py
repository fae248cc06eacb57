"""The sweep: from knots to watertight tubes."""
