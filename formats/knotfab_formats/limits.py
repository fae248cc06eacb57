"""Limits on what this process may still spend on files that others wrote."""

from __future__ import annotations

import contextlib

# processor seconds on each core, and GB of memory, to read and measure one piece
MEASURING = 900, 12.0


def limit_process(seconds: float, gigabytes: float) -> None:
    """Allow this process so much more processor time and memory, within its own hard limits.

    Where time runs out, SIGXCPU ends the process; where memory does, MemoryError is raised.
    """
    try:
        import resource
    except ImportError:  # Windows
        return
    with contextlib.suppress(OSError, ValueError):
        with open("/proc/self/statm") as file:
            held = int(file.read().split()[0]) * resource.getpagesize()
        spent = resource.getrusage(resource.RUSAGE_SELF)
        for kind, bound in (
            (resource.RLIMIT_CPU, int(spent.ru_utime + spent.ru_stime + seconds) + 1),
            (resource.RLIMIT_AS, held + int(gigabytes * 2**30)),
            (resource.RLIMIT_CORE, 0),
        ):
            hard = resource.getrlimit(kind)[1]
            resource.setrlimit(kind, (bound if hard < 0 else min(bound, hard), hard))
