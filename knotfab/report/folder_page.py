"""The page of a folder, made of nothing but the folder's files."""

from __future__ import annotations

from pathlib import Path

from knotfab.base.errors import why_of
from knotfab.part.slicer_profile import read_profile
from knotfab.report.for_maker import draw_setup, list_files
from knotfab.report.page import render_html
from knotfab.report.pictures import find_pictures
from knotfab.report.viewer import read_viewer_data
from knotfab_formats.disk import write_whole
from knotfab_formats.errors import InputError, spelled
from knotfab_formats.report import read_report
from knotfab_formats.slicer_ini import PROFILE


def write_page(folder: Path) -> Path:
    """Write report.html from report.json and the other files of its folder.

    Raises:
        InputError: the folder holds no whole build of this version.
    """
    try:
        report = read_report(folder / "report.json")
        shown = read_viewer_data(folder) if report.views else None
    except (OSError, ValueError, TypeError, IndexError) as error:
        which = f" ({why_of(error)})" if isinstance(error, OSError) else " of this version"
        why = f"it holds no whole build{which}"
        raise InputError(str(folder), why, "Build it again with --scene.") from error
    page = render_html(
        report,
        find_pictures(folder),
        report.title,
        shown=shown,
        drawings=draw_setup(folder),
        files=list_files([path.name for path in folder.iterdir()]),
        profile=read_profile(folder) if (folder / PROFILE).is_file() else None,
    )
    path = folder / "report.html"
    write_whole(path, spelled(page).encode())
    return path
