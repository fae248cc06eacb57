"""What the validators say of closed curves: their knot types, and how they are linked."""

from knotfab_validators.arrays import Array
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.knots.knot_types import knot_types


def judge_type(*curves: Array, promise: str = "") -> tuple[str, str]:
    """What the independent check says of the first curve alone or in its link: sentence, verdict."""
    types = knot_types(Curves(curves, (promise,) * len(curves), (True,) * len(curves), 1.0))
    return types.knots[0].sentence, types.knots[0].verdict


def linking_numbers(*curves: Array) -> list[int]:
    """The linking number of every two curves."""
    types = knot_types(Curves(curves, ("",) * len(curves), (True,) * len(curves), 1.0))
    return [n for _, _, n in types.linking.numbers]
