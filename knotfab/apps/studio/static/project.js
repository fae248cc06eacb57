/* From centre lines to two pictures: the shadow on the wall as the lamp throws it, and the knot from the side. */

/* The curves of an event: each is base64 of float32 triples. */
export function unpack(curves) {
  return curves.map((text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Float32Array(bytes.buffer);
  });
}

/* As the viewer takes them. */
export function asLists(curves) {
  return curves.map((flat) => {
    const points = [];
    for (let k = 0; k < flat.length; k += 3) points.push([flat[k], flat[k + 1], flat[k + 2]]);
    return points;
  });
}

function fit(canvas, ratio) {
  const wide = Math.max(1, Math.round(canvas.clientWidth * Math.min(2, window.devicePixelRatio || 1)));
  const high = Math.round(wide * ratio);
  if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
  return canvas.getContext("2d");
}

export function drawShadow(canvas, view, curves, radius, picture) {
  const ratio = view.frame_height_mm / view.frame_width_mm;
  const context = fit(canvas, ratio);
  const { width, height } = canvas;
  context.fillStyle = "#fbfaf7";
  context.fillRect(0, 0, width, height);
  if (picture) {
    context.globalAlpha = 0.22;
    context.drawImage(picture, 0, 0, width, height);
    context.globalAlpha = 1;
  }
  const project = window.KnotfabViewer.pinholeOf(view);
  const scale = width / view.frame_width_mm;
  context.strokeStyle = "#2b2622";
  context.lineCap = context.lineJoin = "round";
  // strokes of one width at a time
  const widths = new Map();
  for (const flat of curves) {
    const n = flat.length / 3;
    let before = null;
    for (let k = 0; k <= n; k++) {
      const i = 3 * (k % n);
      const [u, v, s] = project([flat[i], flat[i + 1], flat[i + 2]]);
      const here = [width / 2 + u * scale, height / 2 - v * scale, Math.round(2 * radius * s * scale * 2) / 2];
      if (before) {
        if (!widths.has(here[2])) widths.set(here[2], new Path2D());
        const path = widths.get(here[2]);
        path.moveTo(before[0], before[1]);
        path.lineTo(here[0], here[1]);
      }
      before = here;
    }
  }
  for (const [wide, path] of widths) {
    context.lineWidth = Math.max(1, wide);
    context.stroke(path);
  }
}

const SLICES = 28;

export function drawSide(canvas, view, curves, radius, turn) {
  const context = fit(canvas, canvas.clientHeight / Math.max(1, canvas.clientWidth));
  const { width, height } = canvas;
  context.clearRect(0, 0, width, height);
  const size = view ? 1.25 * Math.max(view.frame_width_mm, view.frame_height_mm) : 240;
  const scale = Math.min(width, height) / size;
  const [cy, sy, cp, sp] = [Math.cos(turn[0]), Math.sin(turn[0]), Math.cos(turn[1]), Math.sin(turn[1])];
  const pieces = [];
  for (const flat of curves) {
    const n = flat.length / 3;
    let before = null;
    for (let k = 0; k <= n; k++) {
      const i = 3 * (k % n);
      const x = cy * flat[i] + sy * flat[i + 2];
      const z = -sy * flat[i] + cy * flat[i + 2];
      const here = [width / 2 + x * scale, height / 2 - (cp * flat[i + 1] - sp * z) * scale, sp * flat[i + 1] + cp * z];
      if (before) pieces.push([before, here]);
      before = here;
    }
  }
  // from far to near in slices, each with a rim of the paper's colour, so that strands pass over one another
  const slices = Array.from({ length: SLICES }, () => new Path2D());
  for (const [a, b] of pieces) {
    const near = Math.min(0.999, Math.max(0, 0.5 + (0.5 * (a[2] + b[2])) / (0.7 * size)));
    const path = slices[Math.floor(near * SLICES)];
    path.moveTo(a[0], a[1]);
    path.lineTo(b[0], b[1]);
  }
  const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
  const tube = 2 * radius * scale;
  context.lineJoin = "round";
  slices.forEach((path, k) => {
    const near = k / (SLICES - 1);
    const light = dark ? 30 + 46 * near : 78 - 46 * near;
    for (const [wide, tone, cap] of [[tube + 3, dark ? "#171513" : "#f7f4ee", "butt"], [tube, `hsl(24 46% ${light}%)`, "round"], [0.35 * tube, `hsl(28 52% ${light + 9}%)`, "round"]]) {
      context.lineCap = cap;
      context.lineWidth = Math.max(1, wide);
      context.strokeStyle = tone;
      context.stroke(path);
    }
  });
}
