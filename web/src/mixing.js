/* Several lamps on one screen: how much of its light each is, and how much of the picture has its right colour. */

/* The tints of lamps (black of one that is off) and what other light there is, in shares of what is white, channel
   by channel: all lamps and the other light, of which there is `ambient` times as much as of theirs. */
export function mixtureOf(views, lit, ambient) {
  const colours = views.map((view) => view.lamp_colour ?? [1, 1, 1]);
  const sum = [0, 1, 2].map((c) => colours.reduce((all, colour) => all + colour[c], 0));
  const share = (value, c) => (sum[c] > 0 ? value / sum[c] / (1 + ambient) : 0);
  return {
    tints: colours.map((colour, k) => colour.map((value, c) => (lit[k] ? share(value, c) : 0))),
    other: sum.map((value, c) => share(ambient * value, c)),
  };
}

/* The share of pixels that are dark in just those shadows in whose pictures they are; `shadows` are of the frame. */
export function shareRight(pictures, shadows) {
  const { width, height } = shadows[0];
  let right = 0;
  for (let y = 0; y < height; y++)
    for (let x = 0; x < width; x++) {
      const same = shadows.every(({ data }, k) => {
        const { mask } = pictures[k];
        const [u, v] = [Math.floor(((x + 0.5) / width) * mask.width), Math.floor(((y + 0.5) / height) * mask.height)];
        return data[y * width + x] > 127 === mask.dark[4 * (v * mask.width + u)] > 127;
      });
      if (same) right++;
    }
  return right / (width * height);
}
