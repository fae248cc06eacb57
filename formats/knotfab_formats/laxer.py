"""Where a scene asks for less than the printer, material and accuracy that it names."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

# process of printers that are known by name; all others print filament
PROCESS = {"form-3": "resin", "sls": "powder", "hp-mjf": "powder"}
OUTLINE_PX = {"sketch": 1.5, "draft": 1.0}  # most error of the outline by accuracy; else 0.5
MODULUS_MPA = {
    "abs": 2100.0,
    "asa": 1900.0,
    "petg": 1700.0,
    "tpu": 26.0,
    "resin": 2700.0,
}  # else 2300
SIDES_MM = {  # the longest side of what printers build; others may build anything
    **dict.fromkeys(("bambu-a1-mini", "prusa-mini"), 180.0),
    **dict.fromkeys(("prusa-mk3s", "prusa-mk4", "prusa-mk4s", "generic-220"), 250.0),
    **dict.fromkeys(("ender-3", "ender-3-v2", "ender-3-v3"), 250.0),
    **dict.fromkeys(("bambu-a1", "bambu-p1p", "bambu-p1s", "bambu-x1", "creality-k1"), 256.0),
    **{"ender-3-s1": 270.0, "prusa-core-one": 270.0, "prusa-xl": 360.0, "voron-2.4-350": 350.0},
    **{"form-3": 185.0, "hp-mjf": 380.0, "sls": 600.0},
}
# what each key may be at least and at most, by what the printer prints with ("" all)
BOUNDS: dict[str, dict[str, tuple[float, float]]] = {
    "": {
        "piece.clearance_mm": (0.2, 1e9),
        "mount.max_sag_mm": (0.0, 3.0),
        "views.light_diameter_mm": (0.0, 60.0),
        "views.threshold": (0.05, 0.95),
        "views.speck_px": (0.0, 1000.0),
    },
    "filament": {
        "printer.min_wall_mm": (0.35, 1e9),
        "printer.min_gap_mm": (0.35, 1e9),
        "printer.layer_height_mm": (0.08, 0.6),
        "printer.nozzle_mm": (0.1, 1.2),
        "printer.max_overhang_deg": (0.0, 50.0),
        "printer.max_bridge_mm": (0.0, 15.0),
    },
    "resin": {
        "printer.min_gap_mm": (0.05, 1e9),
        "printer.layer_height_mm": (0.02, 0.2),
        "printer.max_overhang_deg": (0.0, 75.0),
        "printer.max_bridge_mm": (0.0, 30.0),
    },
    "powder": {"printer.min_wall_mm": (0.4, 1e9), "printer.min_gap_mm": (0.4, 1e9)},
}


def tell_laxer(scene: Any, knots: Any = None) -> str:
    """Say which keys of a scene ask for less than what it names needs; empty if none does.

    Args:
        knots: what knots.json says, if it is there: a mount or bars were made for more than the scene asks.
    """
    laxer = dict.fromkeys(f"{key} = {value}" for key, value in _find(scene, knots))
    needs = f"{scene.printer.name} in {scene.material.name} needs"
    return f"the scene asks for less than {needs}: {', '.join(laxer)}" if laxer else ""


def _find(scene: Any, knots: Any) -> Iterator[tuple[str, object]]:
    piece, printer, mount = scene.piece, scene.printer, scene.mount
    process = PROCESS.get(
        printer.name, "filament" if printer.process == "powder" else printer.process
    )
    if printer.process == "powder" != process:
        yield "process", '"powder"'
    elif scene.material.process != printer.process:
        yield "process", f'"{scene.material.process}"'
    for dotted, (least, most) in (BOUNDS[""] | BOUNDS[process]).items():
        table, key = dotted.split(".")
        for one in scene.views if table == "views" else [getattr(scene, table)]:
            value = getattr(one, key, None)
            if value is not None and not least <= value <= most:
                yield key, f"{value:g}"
    longest = max(getattr(printer, "build_volume_mm", None) or (0.0,))
    if longest > 1.05 * SIDES_MM.get(printer.name, longest):
        yield "build_volume_mm", f"{longest:g}"
    error = scene.accuracy.max_outline_error_px
    if error is not None and error > OUTLINE_PX.get(scene.accuracy.name, 0.5):
        yield "max_outline_error_px", f"{error:g}"
    material = scene.material
    if material.young_modulus_mpa > 1.5 * MODULUS_MPA.get(material.name, 2300.0):
        yield "young_modulus_mpa", f"{material.young_modulus_mpa:g}"
    bend = material.min_bend_radius_mm
    if None not in (bend, piece.tube_radius_mm) and bend < 0.95 * piece.tube_radius_mm:
        yield "min_bend_radius_mm", f"{bend:g}"
    if knots is None:
        return
    held = bool(knots.members or knots.plate is not None or scene.lamps.table)
    if not piece.printed and (held or knots.bars):
        yield "printed", "false"
    if piece.supports != "none" and knots.bars:
        yield "supports", f'"{piece.supports}"'
    if knots.plate is not None and mount.plate == "pegs":
        yield "plate", '"pegs"'
    if knots.members and not mount.pegs:
        yield "pegs", "[]"
