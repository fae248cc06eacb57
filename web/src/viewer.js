/* KnotfabViewer: the part in 3D with lamp, wall and the shadow it casts, moved by hand.

   One classic script, nothing loaded from elsewhere. The interface (docs/viewer.md has it in full):

     const viewer = KnotfabViewer.mount(element, data, {controls: true})
     viewer.setCurves([[[x, y, z], …], …], radius_mm)   replace the tubes; quick enough for 10 times a second
     viewer.setScene(data)                              replace everything: views, meshes, print, history
     viewer.setView(index)                              which view's lamp and wall are shown
     viewer.setLamp({distance, height, side, diameter, tilt, turn})   mm and degrees; what is not named stays
     viewer.setLit([true, false, …])                    which lamps are on, where several mix on one screen
     viewer.right()                                     the share of the frame in its right colour then; null elsewhere
     viewer.readMixed(longer = 1024)                    {width, height, data}: red, green and blue, 0…255 in linear
                                                        light, rows from the top, of the frame; null elsewhere
     viewer.readShadow(longer = 1024, soft = false)     {width, height, data}: 0…255, rows from the top, the frame
                                                        padded by a quarter on each side, `longer` px unpadded;
                                                        of a point, or `soft`: averaged over the lamp
     viewer.iou()                                       of shadow and picture on that grid; null without a picture
     viewer.dispose()

     KnotfabViewer.pinholeOf(view)   [x, y, z] to [right, up, scale] on the view's wall, mm from the frame's middle;
                                     it needs no WebGL

   data, all in mm and scene coordinates (x right, y up, z to the lamp, the middle of the piece the origin):

     unit      "mm"
     radius    of the tube
     curves    closed centre lines: [[x, y, z], …], or packed: {q: base64 of uint16 (n, 3), low: [3], step}
     views     [{the keys of a scene's [[views]]: name, kind "shadow" | "eye", frame_width_mm, frame_height_mm,
                 light_distance_mm (Infinity or null: the sun), light_shape ("disc", "ball", "rectangle", "leds"),
                 light_diameter_mm, light_width_mm, light_height_mm, light_leds [columns, rows],
                 wall_distance_mm, wall_tilt_deg,
                 azimuth_deg, elevation_deg, frame_up_mm, light_right_mm, light_up_mm, lamp_colour [r, g, b], linear;
                 picture: data URI of its silhouette, dark on light or on nothing}]
     lamps?    {mode: "mix" | "switch", screen: "ends" | "open", ambient?}: all views share one screen
     meshes?   what else casts shadow, such as a mount: {positions: packed or [[x, y, z], …],
                 faces: base64 of uint32 (m, 3) or [[i, j, k], …]}
     wall_mounted?  true: the piece is fixed to the wall, and tilts with it
     print?    {matrix: 4×4 rows, part.stl → scene; bed_mm: [x, y]; supports?: {cell_mm, q, low, step}: packed columns
                 (x, y, from z, to z), n × 4, in the coordinates of part.stl}
     history?  [{curves, radius?, label?, picture?}]: the frames of a sequence
*/
import { pinholeOf } from "./camera.js";
import { Stage } from "./stage.js";
import { buildPanel } from "./panel.js";
import { adoptStyle } from "./style.js";

export { pinholeOf };

export function mount(element, data, options = {}) {
  const root = element.shadowRoot ?? element.attachShadow({ mode: "open" });
  root.replaceChildren();
  adoptStyle(root);
  const stage = new Stage(root, data);
  const panel = options.controls === false ? null : buildPanel(root, stage);
  return {
    setCurves: (curves, radius) => stage.setCurves(curves, radius),
    setScene(next) {
      stage.setScene(next);
      panel?.refresh();
    },
    setView(index) {
      stage.setView(index);
      panel?.refresh();
    },
    setLamp(changes) {
      stage.setLamp(changes);
      panel?.refresh();
    },
    setLit(lit) {
      stage.setLit(lit);
      panel?.refresh();
    },
    right: () => stage.right(),
    readMixed: (longer) => stage.readMixed(longer),
    readShadow: (longer, soft) => stage.readShadow(longer, soft),
    iou: () => stage.iou(),
    dispose() {
      panel?.dispose();
      stage.dispose();
      root.replaceChildren();
    },
  };
}

/* A page mounts by itself: <div data-knotfab-viewer="ID"> with its data in <script type="application/json" id="ID">. */
function mountAll() {
  for (const element of document.querySelectorAll("[data-knotfab-viewer]")) {
    const source = document.getElementById(element.dataset.knotfabViewer);
    if (!source) continue;
    element.viewer = mount(element, JSON.parse(source.textContent));
  }
}

if (typeof document !== "undefined") {
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", mountAll);
  else mountAll();
}
