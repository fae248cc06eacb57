"""Pictures in colours taken apart into lamps' masks: what is drawn by hand comes apart as it was drawn."""

import numpy as np
import pytest
from PIL import Image, ImageDraw
from scipy.ndimage import label

from knotfab.picture.lamps import mixtures_of, on_one_canvas, separate, to_oklab
from knotfab.picture.read import Target
from knotfab_formats.errors import InputError

RGB = np.eye(3)
NAMES = ("red", "green", "blue")


def flags(*colours: str, size: int = 160, blur: int = 4) -> Image.Image:
    """Discs side by side on white, each in a colour over the next, antialiased."""
    big = Image.new("RGB", (size * blur, size * blur), "white")
    draw = ImageDraw.Draw(big)
    for n, colour in enumerate(colours):
        x = size * blur * (0.18 + 0.6 * n / len(colours))
        draw.ellipse([x, 0.2 * size * blur, x + 0.4 * size * blur, 0.8 * size * blur], fill=colour)
    return big.resize((size, size), Image.Resampling.LANCZOS)


def parted(image: Image.Image, **more: object) -> dict[tuple[int, ...], float]:
    return separate(image, NAMES, RGB, "a.png", **more).shares  # type: ignore[arg-type]


def test_three_lamps_mix_the_eight_corners_of_the_cube() -> None:
    shown = mixtures_of(RGB)
    assert shown[0] == pytest.approx([1, 1, 1]) and shown[7] == pytest.approx([0, 0, 0])
    assert shown[1] == pytest.approx([0, 1, 1])  # where the red lamp is hidden
    assert shown[6] == pytest.approx([1, 0, 0])
    lit = mixtures_of(RGB, ambient=0.1)
    assert lit[0] == pytest.approx([1, 1, 1]) and 0 < lit[7].max() < 0.4
    warm = mixtures_of(np.array([[1.0, 0.5, 0.2], [1.0, 1.0, 1.0]]))
    # bluish without warm light
    assert warm[0] == pytest.approx([1, 1, 1]) and warm[1][2] > warm[1][0]


def test_each_lamp_is_hidden_where_its_light_is_not_wanted() -> None:
    found = separate(flags("#ff0000", "#ffff00", "#0000ff"), NAMES, RGB, "a.png")
    assert set(found.shares) == {(), (1, 2), (2,), (0, 1)}
    assert found.lines == () and found.error < 0.02
    rows, columns = 80, [40, 80, 110]
    assert [tuple(found.masks[:, rows, c]) for c in columns] == [
        (False, True, True),
        (False, False, True),
        (True, True, False),
    ]


@pytest.mark.parametrize(
    "pair", [("#ffff00", "#0000ff"), ("#00ff00", "#ff00ff"), ("#ff0000", "#00ffff")]
)
def test_no_seam_of_a_third_colour_runs_between_two(pair: tuple[str, str]) -> None:
    image = flags(*pair)
    found = separate(image, NAMES, RGB, "a.png")
    wanted = set(found.shares) - {()}
    assert len(wanted) == 2
    soft = Image.fromarray(np.asarray(image)).resize((320, 320), Image.Resampling.BICUBIC)
    assert set(parted(soft)) == {(), *wanted}  # blurred over more pixels


def test_outlines_stay_though_they_lie_between_colours() -> None:
    image = flags("#ffff00", "#0000ff", size=200)
    draw = ImageDraw.Draw(image)
    draw.line([(0, 100), (200, 100)], fill="black", width=5)
    shares = parted(image)
    assert shares[0, 1, 2] == pytest.approx(5 / 200, abs=0.004)


def test_dark_colours_keep_their_hue_and_greys_stay_grey() -> None:
    shares = parted(flags("#008000", "#800000", "#0000a0"))
    assert {(0, 2), (1, 2), (0, 1)} <= set(shares) and (0, 1, 2) not in shares
    soft = parted(flags("#3cb371", "#ff7f50", "#4169e1"))
    assert {(0, 2), (1, 2), (0, 1)} <= set(soft)
    light = parted(flags("#c8c8c8", "#ff0000", "#0000ff", "#00ff00"))
    assert set(light) == {(), (1, 2), (0, 1), (0, 2)}


def test_what_cannot_be_mixed_is_told_and_few_colours_are_few() -> None:
    image = flags("#ff8800", "#ff0000", "#0000ff", "#00ff00")
    found = separate(image, NAMES, RGB, "a.png")
    assert any("#ff8800" in line for line in found.lines)
    assert len(parted(image, most=3)) <= 3 < len(parted(image))


@pytest.mark.parametrize(
    ("colours", "why"),
    [(("#000000", "#808080"), "it is grey"), (("#ff0000", "#ff0000"), "hides the lamp 'red'")],
)
def test_what_lamps_cannot_show_is_refused(colours: tuple[str, str], why: str) -> None:
    with pytest.raises(InputError, match=why):
        parted(flags(*colours))


def test_oklab_of_known_colours() -> None:
    white, red = to_oklab(np.array([[1.0, 1, 1], [1, 0, 0]]))
    assert white == pytest.approx([1, 0, 0], abs=1e-4)
    assert red == pytest.approx([0.628, 0.2249, 0.1258], abs=1e-3)  # Ottosson's own table


def test_pictures_of_lamps_that_switch_share_a_canvas() -> None:
    wide, high = np.zeros((40, 80), bool), np.zeros((60, 60), bool)
    wide[10:30, 10:70] = high[10:50, 20:40] = True
    targets = tuple(Target("t", m) for m in (wide, high))
    one, two = on_one_canvas(targets)
    assert one.mask.shape == two.mask.shape == (40, 80)
    assert one.mask.mean() == pytest.approx(wide.mean())
    assert two.mask.sum() == pytest.approx(high.sum() * (40 / 60) ** 2, rel=0.1)
    assert on_one_canvas((one, two)) == (one, two)


def test_a_photograph_is_cut_into_areas_that_a_tube_can_draw() -> None:
    noise = np.random.default_rng(0).normal(0, 25, (320, 320, 3))
    grainy = np.clip(
        np.asarray(flags("#c03020", "#2040c0", "#20a040", size=320), float) + noise, 0, 255
    )
    found = separate(Image.fromarray(grainy.astype(np.uint8)), NAMES, RGB, "a.png")
    assert all(label(mask)[1] <= 4 for mask in found.masks)
    assert {(1, 2), (0, 1), (0, 2)} <= set(found.shares)


def test_what_tapers_off_goes_to_what_lies_beside_it_and_thin_lines_stay() -> None:
    image = Image.new("RGB", (400, 400), "white")
    draw = ImageDraw.Draw(image)
    draw.ellipse((60, 60, 260, 260), fill="red")
    draw.ellipse((100, 75, 258, 245), fill="blue")  # leaves a crescent whose horns meet, hair-thin
    draw.line((20, 330, 380, 330), fill="red", width=3)
    found = separate(image, NAMES, RGB, "a.png")
    hidden = found.masks[1] & ~found.masks[0]  # red
    assert hidden[330, 30:370].all()
    assert hidden[160, 62:98].all() and not hidden[155:166, 200:].any()
    assert np.asarray(image)[160, 259].tolist() == [255, 0, 0]  # as it came
