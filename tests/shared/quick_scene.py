"""A scene whose piece, of a thick tube, is searched in a few seconds."""

QUICK = """
schema = 1
[accuracy]
name = "draft"
[search]
coarse_px = 96
fine_px = 160
coarse_iterations = 25
fine_iterations = 20
settle_iterations = 20
depth_candidates = 8
"""


def ask_quick(**accuracy: float) -> str:
    """The same, with more asked of its accuracy."""
    more = "".join(f"{key} = {value}\n" for key, value in accuracy.items())
    return QUICK.replace("[search]", f"{more}[search]")
