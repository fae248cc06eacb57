"""Mutants of the validators that no test need notice, each with the reason."""

from __future__ import annotations

import re
from typing import Protocol


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

BOUNDS_OF_WORK = """
BATCH BLOCK BLOCKS_AT_ONCE BLOCK_LEVEL FACES_AT_ONCE HOPELESS FEWEST MANY_PAIRS
MOST_A_FACE MOST_ACROSS MOST_AT_ONCE MOST_BATCHES MOST_BODIES MOST_BOXES MOST_BYTES
MOST_COMPARED MOST_COUNTED MOST_CROSSINGS MOST_CUT MOST_EXACT MOST_FACTORS MOST_HOPS
MOST_LOOKS MOST_MOVES MOST_NEAR MOST_OF_SUMS MOST_OF_UNKNOT NEAREST_PAIRS MOST_PAIRS
MOST_RINGS MOST_SAMPLES MOST_SEEDS MOST_SEEN MOST_SHAKEN MOST_STATES
MOST_STEPS MOST_TESTS MOST_TORUS_CROSSINGS PAIRS_AT_ONCE ROUNDS ROWS_AT_ONCE SHAKES
SOME_SHAKES STARTS TOP_ARCS
"""

# (module within the package, constant or comparison); * for all modules, or all of a module's
EXCUSES: dict[tuple[str, str], str] = {
    **{("*", name): EFFORT for name in BOUNDS_OF_WORK.split()},
    ("failure_picture", "*"): DRAWN,
    ("shadows.pictures", "*"): DRAWN,
    ("check", "MOST_PLACES"): MARKED,
    ("knots.alexander", "ROW_BITS"): MARGIN,
    ("knots.alexander", "LARGEST_PRIME"): "any large prime will do, and most numbers below",
    ("printing.bridges", "STEP"): GRAIN,
    ("printing.bridges", "LEVEL_MM"): MARGIN,
    ("printing.bridges", "OPPOSITE"): "an angle that the grid resolves to some degrees, not to 1 %",
    ("tube.clearance", "SPACING"): GRAIN,
    ("tube.clearance", "LOOK"): EFFORT,
    ("tube.clearance", "OWN"): MARGIN,
    ("tube.clearance", "gap.distance < 0"): WORDS,
    ("tube.clearance", "distance > 0"): EDGE,
    ("tube.clearance", "gap.distance > 0"): EDGE,
    ("printing.columns", "CELL_MM"): GRAIN,
    ("shadows.compare", "LEGIBILITY_PX"): GRAIN,
    ("tube.critical_chords", "ANGLE_TOLERANCE"): MARGIN,
    ("tube.critical_chords", "ROUNDING"): MARGIN,
    ("tube.critical_chords", "CONE_SLACK"): MARGIN,
    ("printing.islands", "LEVEL_MM"): MARGIN,
    ("printing.islands", "UPWARD"): MARGIN,
    ("knots.reduction", "LEAST_SHIFT"): MARGIN,
    ("knots.reduction", "UNCERTAIN"): MARGIN,
    ("knots.knot_types", "MOST_SHOWN"): MARKED,
    ("printing.local_thickness", "cosine >= FACING"): EDGE,
    (
        "printing.local_thickness",
        "-np.einsum('ij,ij->i', self.normals[f], self.normals[g]) >= FACING",
    ): EDGE,
    ("printing.local_thickness", "SAMPLE_MM"): GRAIN,
    ("printing.local_thickness", "SLIVER_MM"): MARGIN,
    ("printing.local_thickness", "SEED_MM"): EFFORT,
    ("printing.local_thickness", "NEAR_MM"): EFFORT,
    ("printing.local_thickness", "SLANTING"): EFFORT,
    ("printing.local_thickness", "MET_MM"): MARGIN,
    ("printing.local_thickness", "START_MM"): MARGIN,
    ("files.bad_file", "*"): GUARDS,
    ("mesh.surface_checks", "BESIDE"): MARGIN,
    ("mesh.surface_checks", "len(found.genus) > 10"): WORDS,
    ("mesh.surface_checks", "len(where) > 1"): WORDS,
    ("mesh.surface_checks", "len(bodies) > 1"): WORDS,
    ("mesh.surface_checks", "rounded < flat"): WORDS,
    ("shadows.layers", "*"): INFORMS,
    ("shadows.misplacement", "*"): INFORMS,
    ("tube.mount_matter", "BESIDE"): GRAIN,
    ("tube.mount_matter", "OFF"): MARGIN,
    ("tube.mount_matter", "distance <= PROUD * radius"): EDGE,
    ("tube.mount_matter", "REACH"): MARGIN,
    ("tube.mount_matter", "SPACING"): GRAIN,
    ("geometry.near_segments", "ROUNDING"): MARGIN,
    (
        "shadows.outline_stretch",
        "*",
    ): "distances on the grid are roots of whole numbers less a half: none near 2",
    ("printing.overhang", "-normals[:, 2] > limit + ANGLE_TOLERANCE"): EDGE,
    ("shadows.lamp", "WIDE_PX"): GRAIN,
    ("printing.plates", "order[0] < len(missing)"): WORDS,
    ("printing.plates", "both[order] > min(APART_MM, worst / 2)"): MARKED,
    ("printing.plates", "outside > APART_MM"): EDGE,
    ("printing.plates", "winding_numbers(vertices[beyond], part, exact=False) > 0.5"): EDGE,
    ("printing.printability", "longest > 0"): WORDS,
    ("printing.printability", "len(found) > 1"): WORDS,
    ("printing.printability", "counted[worst] > 0"): MARKED,
    ("printing.printability", "span > _longest_bridge(use)"): MARKED,
    ("knots.projection", "DIRECTIONS"): EFFORT,
    ("knots.projection", "KEPT"): EFFORT,
    ("knots.projection", "ALL_PAIRS"): EFFORT,
    ("files.threemf", "*"): GUARDS,
    ("files.knots", "MOST_KNOTS"): GUARDS,
    ("files.obj", "*"): GUARDS,
    ("files.ply", "*"): GUARDS,
    ("tube.region_mesh", "SAMPLE_MM"): GRAIN,
    ("tube.region_mesh", "SINGLE"): MARGIN,
    ("shadows.render", "EGL_PLATFORM_DEVICE"): "a number of the EGL interface",
    ("mesh.second_opinion", "SAMPLES"): EFFORT,
    ("shadows.penumbra", "BLUR_TOLERANCES"): INFORMS,
    ("shadows.part_shadows", "MISPLACED_PX"): GRAIN,
    ("printing.standing", "FLAT"): MARGIN,
    ("geometry.surface", "FLAT"): MARGIN,
    ("tube.thickness", "len(lengths) > 1"): WORDS,
    ("files.threemf_model", "*"): GUARDS,
    ("shadows.exact_shadow", "NEAREST"): MARGIN,
    ("shadows.tube_field", "MARGIN_PX"): EFFORT,
    ("shadows.tube_field", "MOST_PIXELS"): EFFORT,
    ("shadows.tube_field", "AT_ONCE"): EFFORT,
    ("shadows.tube_field", "ROUND"): GRAIN,
    ("tube.tube_fit", "STEP"): GRAIN,
    ("tube.tube_fit", "RING_STEP"): GRAIN,
    ("tube.tube_fit", "ANGLES"): GRAIN,
    ("tube.tube_fit", "LEVELS"): EFFORT,
    ("tube.tube_fit", "REACH"): "beyond the limit by far: what is farther is said to be that far",
    ("tube.tube_fit", "bare > LIMIT"): MARKED,
    ("tube.tube_fit", "fit.bare > max(fit.off, LIMIT)"): WORDS,
}


def excuse(mutant: _Named) -> str:
    """Why a mutant is excused, as it stands in the table or names a constant there; or empty."""
    for subject in (mutant.subject, *NAME.findall(mutant.subject), "*"):
        for module in (mutant.module, "*"):
            if (module, subject) in EXCUSES:
                return EXCUSES[module, subject]
    return ""
