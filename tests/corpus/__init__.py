"""Good and broken parts, made by a script, that the validators are held against."""
