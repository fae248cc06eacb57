"""Nothing opens a file for writing but `write_whole`, or inside a folder that is the process's own."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = "knotfab", "formats/knotfab_formats", "validators/knotfab_validators"

# writers of Python, numpy, Pillow, matplotlib, trimesh, VTK and CAD: by a method's name, or a whole one
WRITES = (
    "write_text write_bytes save savefig savez savez_compressed savetxt tofile imsave imwrite"
    " memmap open_memmap PdfPages screenshot export export_gltf exportStep exportStl export_html"
    " save_graphic WriteToFile FileHandler truncate copyfile copy2 copytree copyfileobj"
)
METHODS = frozenset(WRITES.split())
FUNCTIONS = {"shutil.copy", "shutil.move", "sqlite3.connect"}
# their `open` takes the path first
MODULES = {"io", "builtins", "codecs", "gzip", "bz2", "lzma", "tarfile"}
FIRST = "filename", "file_obj", "fname", "file"  # keywords that name the file
READERS = "Image", "webbrowser", "archive", "self.archive"  # their `open` writes nothing
WITH_MODE = {"ZipFile", "TarFile", "fdopen"}
IN_MEMORY = {"BytesIO", "StringIO"}

STAGED = """base/folder.py:OutputFolder._probe base/folder.py:OutputFolder.write base/moves.py:move_all
    base/moves.py:seal base/moves.py:sync part/files.py:_write_model part/files.py:write_stl
    part/slicer_profile.py:write_profile part/write.py:write_glb pipeline/workshop.py:_draw
    pipeline/workshop.py:Workshop.finish.draw_by_day render/pages.py:write_pages
    render/part_picture.py:draw_part report/report.py:write_report_json
    report/setup.py:write_setup"""
ALLOWED = {
    "disk.py:write_whole": "the one",
    **dict.fromkeys(
        STAGED.split(),
        "inside a build's hidden folder, which mkdtemp makes in the one that the build fills",
    ),
    "service.py:_work_as_copy": "into a pipe",
    **dict.fromkeys(
        (
            *("api.py:_file_of", "part/slicer.py:slice_part", "part/slicer_process.py:run_limited"),
            "pipeline/strangers.py:plain_arrays",
        ),
        "inside a temporary folder of its own",
    ),
    **dict.fromkeys(
        ["base/limited.py:_work_as_copy", "base/pool.py:_serve_as_copy", "base/serve.py:main"],
        "a pipe, a standard stream or the null device",
    ),
    "base/disk.py:open_stream": "grows line by line, and follows links to terminals and pipes alone",
    "base/moves.py:_kept_secret": "a new file under a random name (O_EXCL) in the user's own folder",
}


def find_writers(source: str) -> set[str]:
    """Find the functions of a module (dotted names) that open a file for writing, or may."""
    tree, memory = ast.parse(source), set()
    for one in ast.walk(tree):
        if isinstance(one, ast.Assign) and _last_name(one.value) in IN_MEMORY:
            memory |= {ast.unparse(target) for target in one.targets}
        if (
            isinstance(one, ast.withitem)
            and one.optional_vars
            and _last_name(one.context_expr) in IN_MEMORY
        ):
            memory.add(ast.unparse(one.optional_vars))
    return {where for where, call in _calls(tree, "") if _opens(call, memory)}


def _calls(node: ast.AST, inside: str) -> Iterator[tuple[str, ast.Call]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Call):
            yield inside, child
        named = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        yield from _calls(child, f"{inside}.{child.name}".strip(".") if named else inside)


def _last_name(node: ast.AST) -> str:
    return ast.unparse(node.func).rpartition(".")[2] if isinstance(node, ast.Call) else ""


def _opens(call: ast.Call, memory: set[str]) -> bool:
    owner, _, name = ast.unparse(call.func).rpartition(".")
    given = {k.arg: k.value for k in call.keywords}
    where = [*call.args[:1], *(v for k, v in given.items() if k in FIRST)]
    nowhere = {"os.devnull", *memory}
    if all(ast.unparse(one) in nowhere or _last_name(one) in IN_MEMORY for one in where):
        return name == "touch" or (name == "open" and "mode" in given)
    if (owner, name) == ("os", "open"):
        return len(call.args) != 2 or ast.unparse(call.args[1]) != "os.O_RDONLY"
    if name in ("open", *WITH_MODE) and owner not in READERS:
        first = not owner or owner in MODULES or name in WITH_MODE  # the path comes first
        at = 1 if first else 0
        mode = given.get("mode", call.args[at] if len(call.args) > at else ast.Constant("r"))
        return not isinstance(mode, ast.Constant) or bool(set(str(mode.value)) & set("wax+"))
    return name in METHODS or f"{owner}.{name}" in FUNCTIONS


@pytest.mark.slow
def test_only_write_whole_opens_for_writing() -> None:
    found = {
        f"{file.relative_to(ROOT / package)}:{where}"
        for package in PACKAGES
        for file in sorted((ROOT / package).rglob("*.py"))
        for where in find_writers(file.read_text(encoding="utf-8"))
    }
    assert found - set(ALLOWED) == set(), "write by knotfab_formats.disk.write_whole"
    assert set(ALLOWED) - found == set(), "allowed, and no longer there"


def calls_in(text: str) -> list[str]:
    """Part calls at semicolons that stand by themselves."""
    return [call.strip() for call in text.replace("\n    ", " ").split(" ; ")]


WRITERS = """
    open(p, 'w') ; open(p, mode='ab') ; open(p, 'r+') ; open(p, mode) ; io.open(p, 'x') ; p.open('wb') ;
    p.open(mode='a') ; p.open(m) ; gzip.open(p, 'wt') ; os.open(p, flags) ;
    os.open(p, os.O_WRONLY | os.O_CREAT, 0o666) ; os.fdopen(h, 'w') ; p.touch() ; p.write_text(t) ;
    Path(n).write_bytes(b) ; np.save(p, a) ; np.savez(p, a=a) ; a.tofile(p) ; np.savetxt(p, a) ;
    image.save(p) ; image.convert('L').save(p, 'PNG') ; figure.savefig(p) ; plt.imsave(fname=p, arr=a) ;
    mesh.export(p) ; mesh.export(file_obj=p) ; PdfPages(p) ; shutil.copy(a, b) ; shutil.copyfile(a, b) ;
    shutil.move(a, b) ; copytree(a, b) ; zipfile.ZipFile(p, 'w') ; tarfile.open(p, 'w:gz') ;
    plotter.screenshot(filename=p) ; plotter.screenshot(p) ; logging.FileHandler(p)"""


@pytest.mark.parametrize("line", calls_in(WRITERS))
def test_a_writer_is_found(line: str) -> None:
    assert find_writers(f"class A:\n def b(self):\n  if x: {line}") == {"A.b"}
    assert find_writers(line) == {""}


READING = """
    open(p) ; open(p, 'rb') ; p.open() ; p.open('rb') ; Image.open(p) ; os.open(p, os.O_RDONLY) ;
    image.save(io.BytesIO(), 'PNG') ; f = io.BytesIO()\nfigure.savefig(f) ; mesh.export(file_type='glb')
    ; word.replace('a', 'b') ; zipfile.ZipFile(p) ; plotter.screenshot(return_img=True) ; a.copy() ;
    self.open() ; write_whole(p, b)"""


@pytest.mark.parametrize("line", calls_in(READING))
def test_reading_is_none(line: str) -> None:
    assert find_writers(line) == set()
