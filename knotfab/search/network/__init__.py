"""The invertible network: rigid and affine coupling layers, each a homeomorphism of space."""

from knotfab.search.network.coupling import Coupling
from knotfab.search.network.network import CouplingNetwork
from knotfab.search.network.rigid import Rigid

__all__ = ["Coupling", "CouplingNetwork", "Rigid"]
