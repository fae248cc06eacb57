"""Make a piece as it was planned: write it, have it verified and sliced, draw it, and report it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.design.design import START_FILE, Design
from knotfab.geometry.tube import join_meshes
from knotfab.hold.modeller import rest_modeller
from knotfab.part.assemble import Part
from knotfab.part.slicer import SlicerQueue
from knotfab.part.slicer_profile import write_profile
from knotfab.part.write import pose_scene, write_model, write_part, write_unbuilt
from knotfab.picture.read import Target
from knotfab.pipeline.finish import report_piece
from knotfab.pipeline.piece import Settled, WrittenPiece
from knotfab.pipeline.verifier import Files, Verifier
from knotfab.render.hung_picture import GRAINY, draw_hung, draw_unlit
from knotfab.render.part_picture import PartPainter, place_eyes, why_undrawn
from knotfab.report.page import load_template
from knotfab.report.pictures import place_strangers
from knotfab.report.summary import verdict_without_part
from knotfab.request import Request
from knotfab_formats.report import Report
from knotfab_formats.scene import SettledScene
from knotfab_formats.verdict import View

Made = tuple[WrittenPiece, Report]


@dataclass(frozen=True)
class Workshop:
    """What is needed to finish a piece: its folder, verifier and slicer."""

    folder: OutputFolder
    verifier: Verifier
    slicer: SlicerQueue
    progress: Progress

    def write(
        self,
        request: Request,
        targets: Sequence[Target],
        made: Design,
        settled: Settled | str,
        suffix: str = "",
    ) -> WrittenPiece:
        """Write a design's part, knots, scene and pictures, and submit them to validators and slicer.

        Where there is no part, the verdict says why.

        Args:
            targets: its pictures. settled: its part, or why there is none. suffix: of a frame's files.
        """
        folder, targets = self.folder, tuple(targets)
        if request.printing:
            write_profile(folder.work, made.scene)
        if made.region_stl is not None and made.scene.region.file is not None:
            folder.write(made.scene.region.file, made.region_stl)
        if made.start_json is not None:
            folder.write(START_FILE, made.start_json)
        if isinstance(settled, str):
            scene, verdict = (
                write_unbuilt(folder, made, targets, suffix),
                verdict_without_part(settled),
            )
            return WrittenPiece(made, scene, None, targets, suffix, lambda: verdict)
        made, part, flattening = settled
        with self.progress.stage("part"):
            scene = pose_scene(part)
            write_part(folder, part, scene, targets, request.colours, suffix)
        slicing = None
        if request.printing and "slicer" not in request.skip:
            slicing = self.slicer.submit(folder.file(f"part{suffix}.3mf"), scene)
        files = Files(
            folder.file(f"part{suffix}.stl"),
            folder.file(f"knots{suffix}.json"),
            folder.file(f"scene{suffix}.toml"),
            folder.work,
            folder.file(f"failures{suffix}.png"),
        )
        answer = self.verifier.submit(files).result
        with self.progress.stage("part"):
            write_model(folder, part, scene, suffix)
        files_of = made, scene, part, targets, suffix
        return WrittenPiece(*files_of, answer, slicing, flattening, self.slicer)

    def clear(self, aside: Path | None = None) -> None:
        """Remove all that was written, or move it `aside`, once neither slicer nor validators read it."""
        self.slicer.forget()
        self.verifier.forget()
        for path in list(self.folder.work.iterdir()):
            path.unlink() if aside is None else path.rename(aside / path.name)

    def finish(
        self, request: Request, made: Design, settled: Settled | str, note: str = ""
    ) -> Made:
        """Write a design's piece and report it; `note` is a sentence for the report."""
        piece = self.write(request, request.targets, made, settled)
        piece = replace(piece, notes=(*piece.notes, *filter(None, [note])))
        rest_modeller()
        with _open_painter(piece.part, piece.scene) as painter:
            if piece.part is not None:
                with self.progress.stage("verify"):  # while the validators measure
                    if painter is not None:
                        _draw(painter, piece.part, piece.scene, self.folder)
                    load_template()

            def draw_by_day(found: Sequence[View]) -> None:
                views, eyes = piece.scene.views, place_strangers(piece.scene.views, found)
                if painter is not None and piece.part is not None and len(eyes):
                    unlit = draw_unlit(painter, views, eyes, _desk_mm(painter, piece.part))
                    unlit.save(self.folder.file("unlit.png"), "PNG", **GRAINY)

            report = report_piece(piece, self.folder, request, self.progress, draw_by_day)
        return piece, report


def _open_painter(
    part: Part | None, scene: SettledScene
) -> AbstractContextManager[PartPainter | None]:
    """Open the window in which a part's pictures are drawn; none where there is no part, or no OpenGL."""
    if part is None or why_undrawn() is not None:
        return nullcontext()
    vertices, faces = join_meshes(part.bodies)
    seen = vertices @ part.pose.matrix[:3, :3].T + part.pose.matrix[:3, 3]
    return PartPainter(seen, faces, scene.material.color)


def _draw(painter: PartPainter, part: Part, scene: SettledScene, folder: OutputFolder) -> None:
    """Draw part.png, from several sides, and piece.png, as it hangs with its lamp on."""
    painter.draw_panels(place_eyes(scene.views)).save(folder.file("part.png"), "PNG")
    if part.mounted.hang is not None:
        painter.hang(part.mounted.hang.threads)
    hung = draw_hung(painter, scene.views, _desk_mm(painter, part))
    if hung is not None:
        hung.save(folder.file("piece.png"), "PNG", **GRAINY)


def _desk_mm(painter: PartPainter, part: Part) -> float | None:
    """Return the height of the desk that a part stands on; None without a stand."""
    return float(painter.points[:, 1].min()) if part.mounted.stand is not None else None
