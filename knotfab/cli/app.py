"""The command line: which commands there are, and the exit codes of the contract."""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.exceptions import CycloptsError

from knotfab import __version__
from knotfab.cli.make import batch, build, call_clock, preview, studio
from knotfab.cli.measure import compare, shadow, tradeoff, validate
from knotfab.errors import KnotfabError
from knotfab.options import (
    BATCH_EXAMPLES,
    BUILD_EXAMPLES,
    COMPARE_EXAMPLES,
    PREVIEW_EXAMPLES,
    SHADOW_EXAMPLES,
    STUDIO_EXAMPLES,
    TRADEOFF_EXAMPLES,
    VALIDATE_EXAMPLES,
    Flag,
)

__all__ = ["app", "main"]

app = App(
    name="knotfab",
    version=__version__,
    help="Turns a picture into a knotted tube whose shadow is that picture, proved before you print.\n\n"
    "Exit codes: 0 every required check passed; 1 a check failed or the scene cannot be met; "
    "2 wrong input; 3 this machine lacks something; 130 interrupted.",
    suppress_keyboard_interrupt=False,  # main says what became of the work
)

for _command, _examples in (
    (build, BUILD_EXAMPLES),
    (preview, PREVIEW_EXAMPLES),
    (batch, BATCH_EXAMPLES),
    (studio, STUDIO_EXAMPLES),
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
    from knotfab.cli.summary import print_findings
    from knotfab.doctor import compile_loops, examine

    findings = [compile_loops()] if compile_ else examine()
    print_findings(findings)
    return 3 if any(f.status == "missing" for f in findings) else 0


@app.command
def printers() -> int:
    """List the printers and materials that knotfab knows by name, yours included, with their figures."""
    from knotfab.cli.summary import print_catalogue
    from knotfab.scene.catalogue import materials
    from knotfab.scene.catalogue import printers as known
    from knotfab.scene.own_data import data_folder

    print_catalogue(known(), materials(), data_folder())
    return 0


@app.command
def schema() -> int:
    """Print the JSON schema of scene.toml, for editors that check it while you write."""
    from knotfab.scene.json_schema import dump_schema

    print(dump_schema(), end="")
    return 0


app.register_install_completion_command()


def main(arguments: list[str] | None = None, began: float | None = None) -> None:
    """Run the command line and leave with its exit code.

    Args:
        arguments: those of the process by default.
        began: `time.perf_counter()` from which its times count; by default the start of the process.
    """
    if began is None and arguments is None:
        from knotfab.progress import process_age

        began = time.perf_counter() - process_age()
    call_clock.began = began
    # many small products: threads that wait for each other cost more than they bring, and up to
    # ten times on a shared machine; read when numpy is first imported
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # the libraries make a million things that stay: looked through seldom, they load a tenth faster
    gc.set_threshold(20_000, 20, 20)
    # pydantic's plugins are looked for in every package that is installed, for a tenth of a second
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    asked: list[int] = []

    def interrupt(number: int, _: object) -> None:
        asked.append(number)
        raise KeyboardInterrupt

    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # asked to end, tidy up as after Ctrl-C
        number = getattr(signal, name, None)  # Windows hangs up nobody
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, interrupt)
    try:
        code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except (Exception, KeyboardInterrupt) as error:
        # a compiler drops an interrupt that falls into one of its callbacks, and fails a step later
        if asked or isinstance(error, KeyboardInterrupt):
            stays = str(error) if isinstance(error, KeyboardInterrupt) else ""
            print(f"knotfab: interrupted; {stays or 'nothing was changed'}", file=sys.stderr)
            code = 130
        elif isinstance(error, KnotfabError):
            print(f"knotfab: {error}", file=sys.stderr)
            code = error.exit_code
        elif isinstance(error, CycloptsError):
            print(f"knotfab: {error} See: knotfab --help", file=sys.stderr)
            code = 2
        else:
            raise
    gc.freeze()  # what is left ends with the process: to look through it all would take a second
    sys.exit(code if isinstance(code, int) else 0)
