"""The formats: models of scene.toml, knots.json, report.json, and the names in them.

Maker and validators read the same declaration. Nothing here measures anything, and nothing here imports
either of them.
"""
