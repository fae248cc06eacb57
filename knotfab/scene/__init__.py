"""The scene: everything physical, in millimetres and degrees."""
