"""Serve the studio's page, pictures, and the files of builds, each by a name that is there."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response

from knotfab.files.folder import REJECTED
from knotfab.picture.fonts import list_families
from knotfab.picture.read import PICTURE_SUFFIXES
from knotfab.report.report_html import VIEWER
from knotfab.scene.catalogue import materials, printers
from knotfab.scene.own_data import Kind, title_of
from knotfab.studio.builds import child_of, plain_files
from knotfab.studio.fields import FIELDS
from knotfab.studio.guard import REPORT_POLICY
from knotfab.studio.pictures import thumbnail
from knotfab_formats.scene import Printer

__all__ = ["show_choices", "show_file", "show_page", "show_panel", "show_picture", "show_static"]

_STATIC = Path(__file__).parent / "static"
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".png": "image/png",
    ".gif": "image/gif",
    ".json": "application/json",
    ".pdf": "application/pdf",
    ".3mf": "model/3mf",
    ".stl": "model/stl",
    ".glb": "model/gltf-binary",
}
_LOST = "There is no such file in the studio."


async def show_page(_: Request) -> Response:
    return _show(_STATIC / "index.html")


async def show_static(request: Request) -> Response:
    name = request.path_params["name"]
    if name == "viewer.js":
        return _show(VIEWER)
    return _show(_STATIC / name if name in plain_files(_STATIC) and name != "index.html" else None)


async def show_choices(_: Request) -> Response:
    """Serve the menus' choices."""
    return JSONResponse(
        {
            "printers": _titled("printer", printers()),
            "materials": _titled("material", materials()),
            "fonts": await asyncio.to_thread(list_families),
            "labels": {name: field.label for name, field in FIELDS.items()},
            "usual": Printer().name,
            "suffixes": sorted(PICTURE_SUFFIXES),
        }
    )


def _titled(kind: Kind, found: Mapping[str, Any]) -> list[dict[str, object]]:
    """Return names and titles; of printers the volume that they print, too."""
    return [
        {
            "name": name,
            "title": title_of(kind, name),
            "process": one.process,
            "volume_mm": getattr(one, "build_volume_mm", None),
        }
        for name, one in found.items()
    ]


async def show_picture(request: Request) -> Response:
    studio, name = request.app.state.studio, request.path_params["name"]
    return _show(thumbnail(studio.picture_folder, name) if name in studio.pictures else None)


async def show_panel(request: Request) -> Response:
    """Return a panel of the preview."""
    panels, number = request.app.state.studio.panels, request.path_params["panel"]
    if number >= len(panels):
        return PlainTextResponse(_LOST, 404)
    return Response(panels[number], media_type="image/png")


async def show_file(request: Request) -> Response:
    """Return a file of a build's folder: pictures and the report are shown, everything else is saved."""
    where, name = request.path_params["where"], request.path_params["name"]
    rejected = where.endswith(f"/{REJECTED}")
    folder = request.app.state.studio.folder_of(where.removesuffix(f"/{REJECTED}"))
    if folder is not None and rejected:
        folder = child_of(folder, REJECTED)
    path = None if folder is None else child_of(folder, name)
    if path is None or not path.is_file():
        return _show(None)
    if path.name == "report.html":
        return FileResponse(path, headers={"content-security-policy": REPORT_POLICY})
    if path.suffix in (".png", ".gif"):
        return _show(path)
    kind = "application/octet-stream" if path.suffix in (".html", ".svg") else _type(path)
    return FileResponse(path, media_type=kind, filename=f"{path.parent.name}-{path.name}")


def _show(path: Path | None) -> Response:
    if path is None or not path.is_file():
        return PlainTextResponse(_LOST, 404)
    return FileResponse(path, media_type=_type(path))


def _type(path: Path) -> str:
    return _TYPES.get(path.suffix, "application/octet-stream")
