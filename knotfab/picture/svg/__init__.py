"""SVG pictures: read safely, rewritten to what the library draws, drawn in a process with limits."""
