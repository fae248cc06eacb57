"""The paper's renderers and its network."""
