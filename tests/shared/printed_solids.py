"""How the tests of printing print: a printer, one without supports, and all checks by their names."""

import numpy as np
from solids import prism

from knotfab_formats.piece import Printer
from knotfab_formats.verdict import Check
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.printability import printability_checks

PRINTER = Printer(name="test", nozzle_mm=0.4)
BARE = PRINTER.model_copy(update={"supports": False})  # prints without supports


def run(mesh: Mesh, printer: Printer | None = PRINTER, stands: bool = False) -> dict[str, Check]:
    checks = printability_checks(mesh, printer, seconds={}, stands=stands)
    return {c.name: c for c in checks}


def leaning(angle_deg: float) -> Mesh:
    """A parallelogram whose underside overhangs by an angle; 10 mm high, 20 mm long."""
    shift = 10 * np.tan(np.radians(angle_deg))
    return prism([(0, 0), (6, 0), (6 + shift, 10), (shift, 10)], 20)
