"""SVG pictures: parsed safely, rewritten for resvg, and drawn in a process with limits."""
