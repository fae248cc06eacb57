"""A local page to build pieces on."""
