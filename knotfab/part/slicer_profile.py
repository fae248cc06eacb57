"""A PrusaSlicer profile from the scene's printer and material, and whether one can be made."""

from __future__ import annotations

import re
from math import ceil
from pathlib import Path

from knotfab.geometry.overhang import ROOF_GAP_MM, ROOF_LAYERS, SPACING_MM, SUPPORT_LINE_NOZZLES
from knotfab.part.slicer_process import find_slicer, read_version
from knotfab_formats.print_figures import SlicerWarning
from knotfab_formats.scene import ResolvedScene

PROFILE = "slicer.ini"

BRIM_MM = 3.0
INFILL_PERCENT = 15  # share of the inner space


# °C of nozzle and bed, as the makers of such filament print on its box. A material of another name prints
# like PLA: temperatures change neither the time nor the amount that are read off.
FILAMENTS = {
    "pla": (215, 60),
    "petg": (240, 85),
    "tpu": (230, 50),
    "abs": (250, 100),
    "asa": (255, 100),
}


def why_not_sliced(scene: ResolvedScene) -> str | None:
    """Say why a filament slicer cannot judge this piece; None if it can."""
    resin = "resin" in (scene.material.process, scene.printer.process)
    # narrower is the spot of a laser or a pixel of a screen, not a nozzle
    if resin or scene.printer.nozzle_mm < 0.1:
        return "resin: only its own slicer can say"
    if scene.printer.process == "powder":
        return "powder: no supports, and those who print it pack it"
    return None


def line_width(scene: ResolvedScene) -> float:
    """Return the width of every printed line, mm."""
    return round(1.125 * scene.printer.nozzle_mm, 4)  # as is usual


def profile(scene: ResolvedScene, program: str | None = None) -> dict[str, str]:
    """Return PrusaSlicer's settings for a print of this scene, by their names in its .ini files.

    Bed, height, nozzle, layers and supports are the printer's, density and temperatures the
    material's. The rest describes a cautious machine, so that the time is rather too long than too short.
    Supports are branches (organic) if the `program` that is to read the file can grow them. Names
    are those of PrusaSlicer 2.5, which later versions read too.
    """
    printer, material = scene.printer, scene.material
    across, deep, high = printer.build_volume_mm
    layer, width = printer.layer_height_mm, line_width(scene)
    nozzle_c, bed_c = FILAMENTS.get(material.name, FILAMENTS["pla"])
    # A slope's angle from the level below which it is supported, where ours is from the vertical;
    # 0 would leave the choice to the slicer.
    threshold = min(90, max(1, ceil(90 - printer.max_overhang_deg)))
    alone = scene.piece.supports == "none"
    brim = alone and not scene.mount.on_feet  # feet that stand in no plate are small
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
        "perimeters": 2,
        "fill_density": f"{INFILL_PERCENT}%",
        "skirts": 0,
        "brim_type": "outer_only" if brim else "no_brim",
        "brim_width": BRIM_MM if brim else 0,
        "support_material": int(printer.supports and not alone),
        "support_material_threshold": threshold,
        "support_material_style": _support_style(program),
        "support_material_with_sheath": 0,
        "support_material_extrusion_width": f"{SUPPORT_LINE_NOZZLES * printer.nozzle_mm:g}",
        "support_material_spacing": SPACING_MM,
        "support_material_interface_layers": ROOF_LAYERS,
        "support_material_interface_spacing": ROOF_GAP_MM,
        # Supports stand on strands below without a floor of their own: less to pick off.
        "support_material_bottom_interface_layers": 0,
        # A first layer over supports as thick as any other: thick bridges leave a layer more of air.
        "thick_bridges": 0,
        # Without the variable widths of Arachne it slices in half the time, to the same amount of
        # filament: a tube is several lines thick everywhere.
        "perimeter_generator": "classic",
        # Finer than a nozzle can follow costs time and megabytes.
        "resolution": 0.02,
        "gcode_resolution": 0.05,
        "perimeter_speed": 60,
        "external_perimeter_speed": 40,
        "small_perimeter_speed": 30,
        "infill_speed": 80,
        "solid_infill_speed": 60,
        "top_solid_infill_speed": 40,
        "support_material_speed": 60,
        "gap_fill_speed": 30,
        "bridge_speed": 30,
        "first_layer_speed": 20,
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


def _support_style(program: str | None) -> str:
    """Choose branches, which touch only a strand's underside, or else walls no wider than it.

    A grid would widen the supports to its cells, at twice the filament. A version without branches would
    refuse the file.
    """
    version = None if program is None else read_version(program)
    return "organic" if version is not None and version >= (2, 6) else "snug"  # PrusaSlicer


def write_profile(folder: Path, scene: ResolvedScene) -> None:
    """Write slicer.ini for this machine's PrusaSlicer, unless a filament slicer cannot judge the piece."""
    if why_not_sliced(scene) is None:
        found = profile(scene, find_slicer()).items()
        text = "".join(f"{key} = {value}\n" for key, value in found) + _tell_change(scene)
        (folder / PROFILE).write_text(text, encoding="utf-8")


def _tell_change(scene: ResolvedScene) -> str:
    """Write comments that offer a change of filament above the plate in which a piece stands."""
    if not scene.mount.on_feet:
        return ""
    layers = ceil(
        scene.mount.thickness_mm / scene.material.shrinks_to / scene.printer.layer_height_mm - 1e-6
    )
    return (
        "# A light screen and a dark piece: with this before_layer_gcode in place of that above, printers\n"
        f"# that know M600 ask for other filament above the plate, before layer {layers + 1}.\n"
        f"# before_layer_gcode = G92 E0\\n{{if layer_num == {layers}}}M600{{endif}}\n"
    )


def read_profile(folder: Path) -> dict[str, str]:
    """Read the settings that `write_profile` wrote."""
    lines = (folder / PROFILE).read_text(encoding="utf-8").splitlines()
    return dict(line.split(" = ", 1) for line in lines if not line.startswith("#"))


# PrusaSlicer's warnings, and the answer of knotfab's own checks to each.


# The first pattern found in the text decides; the words are those of versions 2.5 to 2.9.
_KNOWN: tuple[tuple[str, str, bool], ...] = (
    (
        r"Empty layer between",
        "layers in which nothing is laid: what is above them hangs in the air, or is thinner than a "
        "line",
        False,
    ),
    (
        r"no extrusions in the first layer",
        "a body that does not reach the bed, or is thinner than a line there",
        False,
    ),
    (
        r"overlapping or self-intersecting facets",
        "it met a layer's outline that touches itself; knotfab's exact test of the mesh for "
        "self-intersections is what decides, and the lines laid were compared with the surface",
        True,
    ),
    (
        r"(?s)stability issues.*Floating object part",
        "a piece that begins in the air: without supports it cannot be printed",
        False,
    ),
    (
        r"stability issues|Consider enabling supports",
        "overhangs, bridges and standing are measured on the mesh against the printer's own limits: "
        "see the checks of the part's printability",
        True,
    ),
    (
        r"Low bed adhesion|Consider enabling brim",
        "little of a tube touches the bed: print it with a brim",
        True,
    ),
    (
        r"Gtk|GLib|dconf|libEGL|MESA|X11|[Dd]isplay|locale",
        "of the window system or the language of this machine, not of the part",
        True,
    ),
)

_PROGRESS = re.compile(r"^\d+ => |^Slicing result exported to |^\[\d{4}-.*\[(trace|debug|info)\]")
_START = re.compile(r"^print(?:_object)? warning: ")


def explain_warning(text: str) -> SlicerWarning:
    """Add what is known about a warning."""
    for pattern, explanation, settled in _KNOWN:
        if re.search(pattern, text):
            return SlicerWarning(text, explanation, settled)
    return SlicerWarning(text)


def read_warnings(said: str) -> list[SlicerWarning]:
    """Read the warnings in what PrusaSlicer said: all that does not report progress.

    A warning runs over several lines, up to the next line of progress; a repeated one is listed
    once. Each line that belongs to no warning is listed by itself.
    """
    blocks: list[list[str]] = []
    inside = False
    for line in said.splitlines():
        if _PROGRESS.match(line):
            inside = False
        elif _START.match(line):
            blocks.append([_START.sub("", line)])
            inside = True
        elif line.strip():
            if inside:
                blocks[-1].append(line.strip())
            else:
                blocks.append([line.strip()])
    return [explain_warning(text) for text in dict.fromkeys("\n".join(block) for block in blocks)]
