"""Type names for arrays, by the kind of number in them. Docstrings give the shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
Real = NDArray[np.floating[Any]]  # single or double precision
