"""One's own printers and materials: found by name or file, checked key by key, not needed afterwards."""

from pathlib import Path

import pytest
from command import knotfab
from platformdirs.macos import MacOS
from platformdirs.windows import Windows

from knotfab.base.errors import InputError
from knotfab.scene.catalogue import asked_for, materials, printers, resolve
from knotfab.scene.load import dump_scene, parse_scene
from knotfab.scene.own_data import data_folder, known_names, load_file
from knotfab_formats.scene import Material, Printer, Scene

PRINTER = "build_volume_mm = [300, 300, 400]\nnozzle_mm = 0.6\nmin_tube_radius_mm = 1.2\n"
MATERIAL = 'density_g_cm3 = 1.04\nmin_bend_radius_mm = "auto"\nmax_length_mm = 20000\n'


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A person's own data with one printer and one material."""
    for kind, name, text in (("printers", "big", PRINTER), ("materials", "own-asa", MATERIAL)):
        (tmp_path / kind).mkdir()
        (tmp_path / kind / f"{name}.toml").write_text(text)
    monkeypatch.setenv("KNOTFAB_DATA", str(tmp_path))
    return tmp_path


def test_ones_own_are_known_by_name_beside_the_others(own: Path) -> None:
    assert {"big", "prusa-mk4"} <= set(printers()) and {"own-asa", "pla"} <= set(materials())
    scene = resolve(parse_scene('[printer]\nname = "big"\n[material]\nname = "own-asa"'))
    assert scene.printer.build_volume_mm == (300.0, 300.0, 400.0)
    assert scene.printer.layer_height_mm == Printer().layer_height_mm  # a usual key, left out
    assert (scene.material.density_g_cm3, scene.material.max_length_mm) == (1.04, 20000.0)


def test_ones_own_wins_over_one_of_the_same_name(own: Path) -> None:
    (own / "printers" / "ender-3.toml").write_text(PRINTER)
    assert resolve(parse_scene('[printer]\nname = "ender-3"')).printer.nozzle_mm == 0.6
    text = '[printer]\nname = "ender-3"\nnozzle_mm = 0.8'
    assert resolve(parse_scene(text)).printer.nozzle_mm == 0.8  # and the scene over both


def test_a_written_scene_needs_no_file_any_more(own: Path) -> None:
    scene = resolve(
        Scene(printer=asked_for(Printer, "big"), material=asked_for(Material, "own-asa"))
    )
    text = dump_scene(scene)
    (own / "printers" / "big.toml").write_text("broken = [")
    (own / "materials" / "own-asa.toml").unlink()
    assert resolve(parse_scene(text)) == scene


def test_a_file_may_lie_anywhere(own: Path, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'title = "Mine"\n{PRINTER}layer_height_mm = 0.3\n')
    printer = asked_for(Printer, str(path))
    assert (printer.name, printer.layer_height_mm) == ("mine", 0.3)
    assert resolve(Scene(printer=printer)).printer.nozzle_mm == 0.6
    path.write_text(f"[material]\n{MATERIAL}")  # under the header of a scene
    assert asked_for(Material, str(path)).density_g_cm3 == 1.04
    # named like a known one, it takes nothing from that
    named = tmp_path / "form-3.toml"
    named.write_text(PRINTER)
    assert resolve(Scene(printer=asked_for(Printer, str(named)))).printer.layer_height_mm == 0.2


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("nozzle_mm = 0.4\n", r"it lacks build_volume_mm, min_tube_radius_mm\. Add .*\[250"),
        (PRINTER.replace("nozzle_mm", "nozle_mm"), r"no key 'nozle_mm'\. Did you mean 'nozzle_mm'"),
        (PRINTER.replace("0.6", '"0.6 mm"'), r"nozzle_mm is \"0\.6 mm\".*Write nozzle_mm = 0\.6"),
        (
            PRINTER.replace("0.6", "-0.6"),
            r"nozzle_mm is -0\.6, but must be a number not less than 0",
        ),
        (PRINTER.replace("300, 300, 400", "300, 300"), r"build_volume_mm"),
        (PRINTER + 'name = "x"\n', r"named after its file\. Leave name out"),
        (PRINTER + "density_g_cm3 = 1.2\n", r"no key 'density_g_cm3'\. It belongs in \[material\]"),
        ("nozzle_mm = ", r"not valid TOML.*line 1"),
    ],
)
def test_errors_name_file_key_and_remedy(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=says) as caught:
        load_file(Printer, path)
    assert caught.value.what == str(path) and caught.value.exit_code == 2
    assert "[printer]" not in caught.value.why


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such file.*prusa-mk4"):
        asked_for(Printer, "nowhere/mine.toml")
    with pytest.raises(InputError, match="is a directory"):
        load_file(Printer, tmp_path)
    (tmp_path / "mine.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        load_file(Material, tmp_path / "mine.toml")


def test_where_ones_own_are_looked_for(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("KNOTFAB_DATA", raising=False)
    monkeypatch.setenv("HOME", "/home/someone")
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    assert data_folder() == Path("/home/someone/.config/knotfab")
    monkeypatch.setenv("XDG_CONFIG_HOME", "relative")
    assert data_folder() == Path("/home/someone/.config/knotfab")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert data_folder() == tmp_path / "knotfab"
    assert "pla" in known_names("material")  # the folder is not there, and need not be
    monkeypatch.setenv("KNOTFAB_DATA", str(tmp_path / "own"))
    assert data_folder() == tmp_path / "own"


def test_where_ones_own_are_on_other_systems(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("KNOTFAB_DATA", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr("platformdirs.PlatformDirs", MacOS)
    assert data_folder() == tmp_path / "Library" / "Application Support" / "knotfab"
    monkeypatch.setattr("platformdirs.PlatformDirs", Windows)
    monkeypatch.setattr("platformdirs.windows.get_win_folder", lambda _: str(tmp_path / "Local"))
    assert data_folder() == tmp_path / "Local" / "knotfab"
    monkeypatch.setenv("KNOTFAB_DATA", str(tmp_path / "own"))
    assert data_folder() == tmp_path / "own"


@pytest.mark.slow
def test_the_command_line_takes_names_and_files(own: Path, tmp_path: Path) -> None:
    done = knotfab("printers")
    assert done.code == 0 and "300 × 300 × 400" in done.out and "own-asa" in done.out
    assert str(own) in done.out
    for option in ("--printer", "--material"):
        done = knotfab("build", "text:A", option, tmp_path / "none.toml", "--out", tmp_path / "o")
        assert done.code == 2 and "none.toml: there is no such file" in done.err
        done = knotfab("build", "text:A", option, "nonsense", "--out", tmp_path / "o")
        assert done.code == 2 and f"or give a file ({option} FILE.toml)" in done.err
    (own / "printers" / "big.toml").write_text("nozzle = 0.4")
    done = knotfab("printers")
    assert done.code == 2 and "big.toml" in done.err


def test_the_defaults_of_usual_keys_are_the_models(own: Path) -> None:
    assert (
        resolve(Scene(material=asked_for(Material, "own-asa"))).material.color == Material().color
    )
