"""The invertible network: rigid and affine coupling layers, each a homeomorphism of space."""

from knotfab.torch_forms.network.coupling import Coupling
from knotfab.torch_forms.network.network import CouplingNetwork
from knotfab.torch_forms.network.rigid import Rigid

__all__ = ["Coupling", "CouplingNetwork", "Rigid"]
