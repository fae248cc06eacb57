"""The PrusaSlicer profile that a scene implies: a build writes it, and validators compare what is there."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, inf, pi, radians, sin
from typing import NamedTuple

from knotfab_formats.piece import Material, Mount, Printer

PROFILE = "slicer.ini"
STYLES = "organic", "snug"  # of supports: branches, where the slicer can grow them
INFILL_PERCENT = 10  # share of the inner space
# A tube prints as a wall, this share of its radius thick, about a sparse core: .85 of a solid one's stiffness
# about the weaker axis, where it is sliced aslant at `FLANK_DEG` (docs/prints.md)
WALL_SHARE = 0.48
FLANK_DEG = 46.0  # slope of the flattest flanks of arches, from the bed
LEVEL_SHARE = 0.6  # share of the wall that layers close where a tube is level
MOST_WIDTH_NOZZLES = 1.625  # width of an inner loop
USUAL_LAYERS = 3  # that PrusaSlicer prints solid at a top and a bottom
# what it fills of its own accord: sections smaller than these mm²; profiles before 2.0 left it so
USUAL_FILLED_MM2 = 70.0
BRIM_MM = 3.0
# speeds of a first layer, of a top one, and of solid ones between
FIRST_MM_S, TOP_MM_S, SOLID_MM_S = 20, 40, 60
RETRACT_MM, LIFT_MM = 0.8, 0.2  # filament drawn back, and the nozzle's lift, before a travel
SUPPORT_LINE_NOZZLES = 0.9
SPACING_MM = 4.0  # between the lines of supports
ROOF_LAYERS = 2
ROOF_GAP_MM = 0.2

# Degrees of nozzle and bed that the makers of such filament print on its box. A material of another name
# prints like PLA: temperatures change neither the time nor the amount that are read off.
FILAMENTS = {
    "pla": (215, 60),
    "petg": (240, 85),
    "tpu": (230, 50),
    "abs": (250, 100),
    "asa": (255, 100),
}


def line_width_mm(nozzle_mm: float) -> float:
    """Return the width of a printed line: 1.125 times the nozzle, as is usual."""
    return round(1.125 * nozzle_mm, 4)


def layers_of_plate(printer: Printer, material: Material, mount: Mount) -> int:
    """Return how many layers a plate has in which a piece stands."""
    return ceil(mount.thickness_mm / material.shrinks_to / printer.layer_height_mm - 1e-6)


def change_above(layers: int) -> str:
    """Return the before_layer_gcode by which printers ask for other filament above so many layers."""
    return f"G92 E0\\n{{if layer_num == {layers}}}M600{{endif}}"


class Walls(NamedTuple):
    """Loops about a tube's sparse core, the inner ones `width_mm` wide, and layers above and below it.

    In a layer the wall is `thick_mm` thick, and the loops run in its depths `at_mm`.
    """

    loops: int
    width_mm: float
    layers: int
    thick_mm: float
    at_mm: tuple[float, ...]


def plan_walls(printer: Printer, tube_radius_mm: float | None) -> Walls:
    """Choose the fewest loops that make a tube's wall, the printer's thinnest tube's if the radius is open.

    The outermost keeps the usual width, which is the most exact.
    """
    outer, layer = line_width_mm(printer.nozzle_mm), printer.layer_height_mm
    wall = WALL_SHARE * (tube_radius_mm or printer.min_tube_radius_mm)
    overlap = overlap_mm(layer)
    widest = max(MOST_WIDTH_NOZZLES * printer.nozzle_mm, outer)
    loops = 1 + max(1, ceil((wall - outer) / (widest - overlap) - 1e-9))
    width = max(outer, round((wall - outer) / (loops - 1) + overlap, 3))
    layers = max(USUAL_LAYERS, ceil(LEVEL_SHARE * wall / layer - 1e-9))
    inner = (0.5 * (outer + width) + (width - overlap) * k for k in range(loops - 1))
    at = (0.5 * outer, *(0.5 * outer - overlap + deeper for deeper in inner))
    return Walls(loops, width, layers, outer + (loops - 1) * (width - overlap), at)


# what profiles lacked when loops and the slicer filled every tube
FULL = (
    "perimeter_extrusion_width",
    "top_solid_layers",
    "bottom_solid_layers",
    "solid_infill_below_area",
    "only_retract_when_crossing_perimeters",
)


def count_full_loops(printer: Printer, tube_radius_mm: float | None) -> int:
    """Return how many loops fill a tube of this radius, as they did in earlier profiles."""
    radius = tube_radius_mm or printer.min_tube_radius_mm
    return max(2, ceil(radius / line_width_mm(printer.nozzle_mm)) + 1)


def overlap_mm(layer_mm: float) -> float:
    """Return by how much PrusaSlicer lets lines overlap, for their sides are round."""
    return layer_mm * (1 - pi / 4)


def written_wall_mm(settings: Mapping[str, str]) -> float:
    """Return the thickness in a layer of the wall that a profile prints about a core; inf: there is no core.

    Raises:
        ValueError: a setting is missing, or no number.
    """
    try:
        if float(settings.get("solid_infill_below_area", USUAL_FILLED_MM2)) > 0:
            return inf
        outer, loops = float(settings["extrusion_width"]), int(settings["perimeters"])
        inner = float(settings.get("perimeter_extrusion_width", outer))
        overlap = overlap_mm(float(settings["layer_height"]))
    except KeyError as error:
        raise ValueError(f"{error} is missing") from error
    return outer + (loops - 1) * (inner - overlap) if loops > 0 else 0.0


def core_of(printer: Printer, tube_radius_mm: float) -> tuple[float, float]:
    """Return the half axes of a printed tube's core on a flank, level and aslant, over the tube's radius.

    A layer cuts a tube aslant, and there the wall is as thick all around: measured across the tube it is
    thinner above and below the core.
    """
    wall = plan_walls(printer, tube_radius_mm).thick_mm / tube_radius_mm
    return max(1 - wall, 0.0), max(1 - wall * sin(radians(FLANK_DEG)), 0.0)


def stiffness_share(printer: Printer, tube_radius_mm: float) -> float:
    """Return a printed tube's bending stiffness over a full one's: on a flank, about the weaker axis."""
    beside, above = core_of(printer, tube_radius_mm)
    return 1 - beside * above**3


def imply_settings(
    printer: Printer,
    material: Material,
    mount: Mount,
    tube_radius_mm: float | None,
    alone: bool,
    style: str,
) -> dict[str, str]:
    """Return PrusaSlicer's settings for a print of this scene, by their names in its .ini files.

    Bed, height, nozzle, layers and supports are the printer's, density and temperatures the
    material's. The rest describes a cautious machine, so that the time is rather too long than too short.
    Names are those of PrusaSlicer 2.5, which later versions read too.

    Args:
        alone: whether the piece prints without supports. style: one of `STYLES`.
    """
    across, deep, high = printer.build_volume_mm
    layer, width = printer.layer_height_mm, line_width_mm(printer.nozzle_mm)
    walls = plan_walls(printer, tube_radius_mm)
    nozzle_c, bed_c = FILAMENTS.get(material.name, FILAMENTS["pla"])
    # A slope's angle from the level below which it is supported, where ours is from the vertical;
    # 0 would leave the choice to the slicer.
    threshold = min(90, max(1, ceil(90 - printer.max_overhang_deg)))
    brim = alone and not mount.on_feet  # feet that stand in no plate are small
    settings: dict[str, object] = {
        "printer_technology": "FFF",
        "gcode_flavor": "marlin2",
        "bed_shape": f"0x0,{across:g}x0,{across:g}x{deep:g},0x{deep:g}",
        "max_print_height": f"{high:g}",
        "nozzle_diameter": f"{printer.nozzle_mm:g}",
        "filament_diameter": 1.75,
        "filament_density": f"{material.density_g_cm3:g}",
        "filament_type": material.name.upper() if material.name in FILAMENTS else "PLA",
        "temperature": nozzle_c,
        "first_layer_temperature": nozzle_c,
        "bed_temperature": bed_c,
        "first_layer_bed_temperature": bed_c,
        "layer_height": f"{layer:g}",
        "first_layer_height": f"{layer:g}",
        "extrusion_width": f"{width:g}",
        "first_layer_extrusion_width": f"{width:g}",
        "perimeter_extrusion_width": f"{walls.width_mm:g}",
        "perimeters": walls.loops,
        "top_solid_layers": walls.layers,
        "bottom_solid_layers": walls.layers,
        "fill_density": f"{INFILL_PERCENT}%",
        "solid_infill_below_area": 0,  # else it fills every tube
        "skirts": 0,
        "brim_type": "outer_only" if brim else "no_brim",
        "brim_width": BRIM_MM if brim else 0,
        "support_material": int(printer.supports and not alone),
        "support_material_threshold": threshold,
        "support_material_style": style,
        "support_material_with_sheath": 0,
        "support_material_extrusion_width": f"{SUPPORT_LINE_NOZZLES * printer.nozzle_mm:g}",
        "support_material_spacing": SPACING_MM,
        "support_material_interface_layers": ROOF_LAYERS,
        "support_material_interface_spacing": ROOF_GAP_MM,
        # Supports stand on strands below without a floor of their own: less to pick off.
        "support_material_bottom_interface_layers": 0,
        # A first layer over supports as thick as any other: thick bridges leave a layer more of air.
        "thick_bridges": 0,
        "gap_fill_enabled": 0,
        # Beside free legs: the nozzle wipes and is lifted before it leaves one, begins the next where it
        # is nearest, and stays within the legs where it can; what oozes there nobody sees.
        "wipe": 1,
        "retract_length": RETRACT_MM,
        "retract_lift": LIFT_MM,
        "seam_position": "nearest",
        "avoid_crossing_perimeters": 1,
        "only_retract_when_crossing_perimeters": 1,
        # Without the variable widths of Arachne it slices in half the time, to the same amount of
        # filament: a tube is several lines thick everywhere.
        "perimeter_generator": "classic",
        # Finer than a nozzle can follow costs time and megabytes.
        "resolution": 0.02,
        "gcode_resolution": 0.05,
        "perimeter_speed": 60,
        "external_perimeter_speed": 40,
        "small_perimeter_speed": 40,
        "infill_speed": 80,
        "solid_infill_speed": SOLID_MM_S,
        "top_solid_infill_speed": TOP_MM_S,
        "support_material_speed": 60,
        "gap_fill_speed": 30,
        "bridge_speed": 30,
        "first_layer_speed": FIRST_MM_S,
        "travel_speed": 150,
        "machine_limits_usage": "time_estimate_only",
        "silent_mode": 0,
        # Lengths of filament line by line, each from its start, so that they can be added up.
        "use_relative_e_distances": 1,
        "before_layer_gcode": "G92 E0",
        "start_gcode": "G28",
        "end_gcode": "M84",
        # A 3MF may bring scripts to be run on the G-code: none are.
        "post_process": "",
        "thumbnails": "",
    }
    return {key: str(value) for key, value in settings.items()}
