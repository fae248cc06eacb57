"""`python -m knotfab`: the command line."""

from __future__ import annotations

from knotfab.cli.app import main

main()
