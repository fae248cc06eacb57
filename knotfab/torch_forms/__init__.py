"""Forms in torch that a search may be handed: the network, the free pose, other renderers, own terms."""
