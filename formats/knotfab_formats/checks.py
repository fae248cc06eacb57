"""The names of all checks, in one place: what a report lists, and what may be left out by name."""

from __future__ import annotations

MESH = (
    *("mesh_closed", "mesh_winding", "mesh_degenerate", "mesh_duplicate", "mesh_manifold"),
    *("mesh_bodies", "mesh_genus", "mesh_volume", "mesh_self_intersection"),
)
FILES = ("same_3mf",)  # what is printed is what was verified
# checks of the part as a tube, in the place where it is measured
TUBE = ("centre_line", "tube", "mount", "clearance", "region", "build_volume")
KNOTS = ("thickness", "bend", "length", "knot_type", "linking")
PRINTING = (
    *("feature", "gap", "overhang", "support_volume"),
    *("bridge", "floating", "islands", "standing"),
)
HELD = ("level",)  # a part that hangs on a thread
PLATES = ("plate_mesh", "plates", "plates_volume")
TABLE = ("table_mesh", "table", "table_shadow")  # the frame that holds several lamps
# checks that are no concern of a piece that is not to be printed
PRINTER = ("build_volume", *PRINTING, *PLATES, *TABLE)
SHADOWS = (
    *("shadow", "shadow_exact", "outline", "wrong_outline", "recognisable"),
    *("half_light", "intrusion", "tone"),  # a lamp that has a size, a mount, greys
    *("colours", "lamp_colours"),  # several lamps on one screen
)
