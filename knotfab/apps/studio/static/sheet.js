/* A sheet to draw on: strokes of a pen, taken back one by one, handed over as a PNG. */

export class Sheet {
  constructor(canvas, pen) {
    Object.assign(this, { canvas, pen, strokes: [] });
    this.context = canvas.getContext("2d");
    let stroke = null;
    canvas.addEventListener("pointerdown", (e) => {
      e.preventDefault();
      canvas.setPointerCapture(e.pointerId);
      stroke = { width: Number(pen.value), points: [this.at(e)] };
      this.strokes.push(stroke);
      this.draw();
    });
    canvas.addEventListener("pointermove", (e) => {
      if (!stroke) return;
      for (const one of e.getCoalescedEvents?.() ?? [e]) stroke.points.push(this.at(one));
      this.draw();
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (stroke = null));
    this.draw();
  }

  at(event) {
    const box = this.canvas.getBoundingClientRect();
    const scale = this.canvas.width / box.width;
    return [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
  }

  undo() {
    this.strokes.pop();
    this.draw();
  }

  clear() {
    this.strokes = [];
    this.draw();
  }

  get empty() {
    return this.strokes.length === 0;
  }

  draw() {
    const { context, canvas } = this;
    context.fillStyle = "#fff";
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.strokeStyle = "#1d1a18";
    context.lineCap = context.lineJoin = "round";
    for (const { width, points } of this.strokes) {
      context.lineWidth = width;
      context.beginPath();
      context.moveTo(...points[0]);
      for (const point of points) context.lineTo(...point);
      context.stroke();
    }
  }

  blob() {
    return new Promise((done) => this.canvas.toBlob(done, "image/png"));
  }
}
