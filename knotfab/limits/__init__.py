"""Limits that finished knots must keep; all are always guarded."""
