"""The file formats: models of scene.toml, knots.json and report.json, and the names in them.

Maker and validators share these declarations. Nothing here measures anything or imports either of them.
"""
