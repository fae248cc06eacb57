"""The paper's own method: its camera, two renderers, five losses, hyper-parameters and loop."""
