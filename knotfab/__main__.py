"""`python -m knotfab`: the command line."""

from knotfab.cli.app import main

main()
