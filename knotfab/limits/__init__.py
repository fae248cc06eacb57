"""Limits: what the finished knots must keep to. Guarded always; each module is one limit."""
