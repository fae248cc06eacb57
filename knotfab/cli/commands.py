"""The command line: which commands there are."""

from __future__ import annotations

from typing import Annotated

from cyclopts import App, Parameter

from knotfab import __version__
from knotfab.cli.make import batch, build, mcp, preview, studio
from knotfab.cli.measure import compare, shadow, tradeoff, validate
from knotfab.pipeline.options import (
    BATCH_EXAMPLES,
    BUILD_EXAMPLES,
    COMPARE_EXAMPLES,
    MCP_EXAMPLES,
    PREVIEW_EXAMPLES,
    SHADOW_EXAMPLES,
    STUDIO_EXAMPLES,
    TRADEOFF_EXAMPLES,
    VALIDATE_EXAMPLES,
    Flag,
)

app = App(
    name="knotfab",
    version=__version__,
    help="Turns a picture into a knotted tube whose shadow is that picture, proved before you print.\n\n"
    "Exit codes: 0 every required check passed; 1 a check failed or the scene cannot be met; "
    "2 wrong input; 3 this machine lacks something, or knotfab made a mistake; 130 interrupted.",
    suppress_keyboard_interrupt=False,  # main says what became of the work
)

for _command, _examples in (
    (build, BUILD_EXAMPLES),
    (preview, PREVIEW_EXAMPLES),
    (batch, BATCH_EXAMPLES),
    (studio, STUDIO_EXAMPLES),
    (mcp, MCP_EXAMPLES),
    (validate, VALIDATE_EXAMPLES),
    (shadow, SHADOW_EXAMPLES),
    (compare, COMPARE_EXAMPLES),
    (tradeoff, TRADEOFF_EXAMPLES),
):
    app.command(_command, help_epilogue=_examples)


@app.command
def doctor(*, compile_: Annotated[Flag, Parameter(name="--compile")] = False) -> int:
    """Say what this machine has and lacks, with the remedy for each.

    Parameters
    ----------
    compile_
        Only compile the search's loops, so that the first build need not wait for that.
    """
    from knotfab.apps.doctor import compile_loops, examine
    from knotfab.cli.summary import print_findings

    findings = [compile_loops()] if compile_ else examine()
    print_findings(findings)
    return 3 if any(f.status == "missing" for f in findings) else 0


@app.command
def printers() -> int:
    """List the printers and materials that knotfab knows by name, yours included, with their figures."""
    from knotfab.cli.summary import print_catalogue
    from knotfab.scene.catalogue import data_folder, materials
    from knotfab.scene.catalogue import printers as known

    print_catalogue(known(), materials(), data_folder())
    return 0


@app.command
def schema() -> int:
    """Print the JSON schema of scene.toml, for editors that check it while you write."""
    from knotfab_formats.read import dump_schema

    print(dump_schema(), end="")
    return 0


app.register_install_completion_command()
