"""What people start beside a build; found by entry points, and needed by none of the core."""
