"""Mutants of the validators that no test need notice, each with the reason."""

from __future__ import annotations

import re
from typing import Protocol

__all__ = ["EXCUSES", "excuse"]


class _Named(Protocol):
    @property
    def module(self) -> str: ...
    @property
    def subject(self) -> str: ...


NAME = re.compile(r"\b[A-Z][A-Z0-9_]+\b")

WORDS = "chooses words or order of a sentence, no verdict"
MARKED = "chooses which places are marked, no verdict"
DRAWN = "a size on a drawing"
EFFORT = "bounds the work; the result is the same, or is said to be less fine"
GRAIN = "the grain of a sampling: 1 % finer or coarser is as good"
MARGIN = "a margin that lies orders of magnitude from what it parts"
EDGE = "differs only where a rounded number meets a tolerance exactly"
GUARDS = "bounds what a stranger's file may cost or say, orders of magnitude from a part's"
INFORMS = "of a number that informs and has no limit"

# (module, constant or comparison); * for all modules, or all of a module's
EXCUSES: dict[tuple[str, str], str] = {
    **{
        ("*", name): EFFORT
        for name in (
            "BATCH",
            "BLOCK",
            "BLOCKS_AT_ONCE",
            "BLOCK_LEVEL",
            "FACES_AT_ONCE",
            "HOPELESS",
            "FEWEST",
            "MANY_PAIRS",
            "MOST_A_FACE",
            "MOST_ACROSS",
            "MOST_AT_ONCE",
            "MOST_BATCHES",
            "MOST_BODIES",
            "MOST_BOXES",
            "MOST_BYTES",
            "MOST_COMPARED",
            "MOST_COUNTED",
            "MOST_CROSSINGS",
            "MOST_CUT",
            "MOST_EXACT",
            "MOST_FACTORS",
            "MOST_HOPS",
            "MOST_LOOKS",
            "MOST_MOVES",
            "MOST_NEAR",
            "MOST_OF_SUMS",
            "MOST_OF_UNKNOT",
            "NEAREST_PAIRS",
            "MOST_PAIRS",
            "MOST_RANK",
            "MOST_RINGS",
            "MOST_SAMPLES",
            "MOST_SEEDS",
            "MOST_SEEN",
            "MOST_SHAKEN",
            "MOST_STATES",
            "MOST_STEPS",
            "MOST_TESTS",
            "MOST_TORUS_CROSSINGS",
            "PAIRS_AT_ONCE",
            "ROUNDS",
            "ROWS_AT_ONCE",
            "SHAKES",
            "SOME_SHAKES",
            "STARTS",
            "TOP_ARCS",
        )
    },
    ("failure_picture", "*"): DRAWN,
    ("pictures", "*"): DRAWN,
    ("check", "MOST_PLACES"): MARKED,
    ("alexander", "ROW_BITS"): MARGIN,
    ("alexander", "LARGEST_PRIME"): "any large prime will do, and most numbers below",
    ("bridges", "STEP"): GRAIN,
    ("bridges", "LEVEL_MM"): MARGIN,
    ("bridges", "OPPOSITE"): "an angle that the grid resolves to some degrees, not to 1 %",
    ("clearance", "SPACING"): GRAIN,
    ("clearance", "LOOK"): EFFORT,
    ("clearance", "OWN"): MARGIN,
    ("clearance", "gap.distance < 0"): WORDS,
    ("clearance", "distance > 0"): EDGE,
    ("clearance", "gap.distance > 0"): EDGE,
    ("columns", "CELL_MM"): GRAIN,
    ("compare", "LEGIBILITY_PX"): GRAIN,
    ("critical_chords", "ANGLE_TOLERANCE"): MARGIN,
    ("critical_chords", "ROUNDING"): MARGIN,
    ("critical_chords", "CONE_SLACK"): MARGIN,
    ("islands", "LEVEL_MM"): MARGIN,
    ("islands", "UPWARD"): MARGIN,
    ("knot_invariants", "LARGEST"): MARGIN,
    ("knot_reduction", "LEAST_SHIFT"): MARGIN,
    ("knot_reduction", "UNCERTAIN"): MARGIN,
    ("knot_reduction", "NUDGE"): MARGIN,
    ("knot_type", "MOST_SHOWN"): MARKED,
    ("local_thickness", "cosine >= FACING"): EDGE,
    (
        "local_thickness",
        "-np.einsum('ij,ij->i', self.normals[f], self.normals[g]) >= FACING",
    ): EDGE,
    ("local_thickness", "SAMPLE_MM"): GRAIN,
    ("local_thickness", "SLIVER_MM"): MARGIN,
    ("local_thickness", "SEED_MM"): EFFORT,
    ("local_thickness", "NEAR_MM"): EFFORT,
    ("local_thickness", "SLANTING"): EFFORT,
    ("local_thickness", "MET_MM"): MARGIN,
    ("local_thickness", "START_MM"): MARGIN,
    ("mesh", "*"): GUARDS,
    ("mesh_check", "BESIDE"): MARGIN,
    ("mesh_check", "len(found.genus) > 10"): WORDS,
    ("mesh_check", "len(where) > 1"): WORDS,
    ("mesh_check", "len(bodies) > 1"): WORDS,
    ("mesh_check", "rounded < flat"): WORDS,
    ("misplacement", "*"): INFORMS,
    ("mount_matter", "BESIDE"): GRAIN,
    ("mount_matter", "OFF"): MARGIN,
    ("mount_matter", "distance <= PROUD * radius"): EDGE,
    ("mount_matter", "REACH"): MARGIN,
    ("mount_matter", "SPACING"): GRAIN,
    ("near_segments", "ROUNDING"): MARGIN,
    (
        "outline_stretch",
        "*",
    ): "distances on the grid are roots of whole numbers less a half: none near 2",
    ("overhang", "-normals[:, 2] > limit + ANGLE_TOLERANCE"): EDGE,
    ("penumbra", "SAMPLES"): GRAIN,
    ("penumbra", "GOLDEN_ANGLE"): "spreads samples over a disc; any irrational angle does",
    ("plates", "order[0] < len(missing)"): WORDS,
    ("plates", "both[order] > min(APART_MM, worst / 2)"): MARKED,
    ("plates", "outside > APART_MM"): EDGE,
    ("printability", "longest > 0"): WORDS,
    ("printability", "len(found) > 1"): WORDS,
    ("printability", "found.widths < (use.nozzle or 0.0) - tolerance"): MARKED,
    ("printability", "counted[worst] > 0"): MARKED,
    ("printability", "span > _longest(use)"): MARKED,
    ("projection", "DIRECTIONS"): EFFORT,
    ("projection", "KEPT"): EFFORT,
    ("projection", "ALL_PAIRS"): EFFORT,
    ("read_3mf", "*"): GUARDS,
    ("read_knots", "MOST_KNOTS"): GUARDS,
    ("read_mesh", "*"): GUARDS,
    ("read_obj", "*"): GUARDS,
    ("read_ply", "*"): GUARDS,
    ("read_scene", "LEAST"): GUARDS,
    ("read_scene", "MOST"): GUARDS,
    ("read_scene", "MOST_DOTS"): GUARDS,
    ("read_stl", "MOST_NAME"): MARGIN,
    ("region_mesh", "SAMPLE_MM"): GRAIN,
    ("region_mesh", "SINGLE"): MARGIN,
    ("render", "EGL_PLATFORM_DEVICE"): "a number of the EGL interface",
    ("second_opinion", "SAMPLES"): EFFORT,
    ("shadows", "BLUR_PX"): INFORMS,
    ("shadows", "MISPLACED_PX"): GRAIN,
    ("standing", "FLAT"): MARGIN,
    ("surface", "FLAT"): MARGIN,
    ("thickness", "len(lengths) > 1"): WORDS,
    ("threemf_model", "*"): GUARDS,
    ("tube_field", "MARGIN_PX"): EFFORT,
    ("tube_field", "MOST_PIXELS"): EFFORT,
    ("tube_field", "AT_ONCE"): EFFORT,
    ("tube_field", "ROUND"): GRAIN,
    ("tube_fit", "STEP"): GRAIN,
    ("tube_fit", "RING_STEP"): GRAIN,
    ("tube_fit", "ANGLES"): GRAIN,
    ("tube_fit", "LEVELS"): EFFORT,
    ("tube_fit", "REACH"): "beyond the limit by far: what is farther is said to be that far",
    ("tube_fit", "bare > LIMIT"): MARKED,
    ("tube_fit", "fit.bare > max(fit.off, LIMIT)"): WORDS,
}


def excuse(mutant: _Named) -> str:
    """Why a mutant is excused, as it stands in the table or names a constant there; or empty."""
    for subject in (mutant.subject, *NAME.findall(mutant.subject), "*"):
        for module in (mutant.module, "*"):
            if (module, subject) in EXCUSES:
                return EXCUSES[module, subject]
    return ""
