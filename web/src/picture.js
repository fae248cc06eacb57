/* A view's picture: as a texture over the wall, and as a mask that shadows are measured against. */
import { CanvasTexture, LinearFilter } from "three";

export class Picture {
  constructor(source, ready) {
    this.ready = false;
    this.image = new Image();
    this.image.onload = () => {
      const { naturalWidth: width, naturalHeight: height } = this.image;
      const canvas = Object.assign(document.createElement("canvas"), { width, height });
      const paint = canvas.getContext("2d", { willReadFrequently: true });
      paint.fillStyle = "#fff";
      paint.fillRect(0, 0, width, height);
      paint.drawImage(this.image, 0, 0);
      const image = paint.getImageData(0, 0, width, height);
      for (let i = 0; i < image.data.length; i += 4) {
        const [r, g, b] = image.data.subarray(i, i + 3);
        image.data.fill(255 - Math.round(0.3 * r + 0.59 * g + 0.11 * b), i, i + 3);
      }
      paint.putImageData(image, 0, 0);
      this.mask = { width, height, dark: image.data };
      this.texture = new CanvasTexture(canvas);
      this.texture.minFilter = LinearFilter;
      this.texture.generateMipmaps = false;
      this.ready = true;
      ready();
    };
    this.image.src = source;
  }

  /* IoU with a shadow on the frame padded by a quarter, rows from the top; `desk`: not below the frame. */
  iou(shadow, width, height, desk = false) {
    const { mask } = this;
    let [both, either] = [0, 0];
    for (let y = 0; y < height; y++) {
      const t = ((y + 0.5) / height) * 1.5 - 0.25;
      const v = Math.floor(t * mask.height);
      if (desk && t >= 1) break;
      for (let x = 0; x < width; x++) {
        const u = Math.floor((((x + 0.5) / width) * 1.5 - 0.25) * mask.width);
        const within = u >= 0 && v >= 0 && u < mask.width && v < mask.height;
        const p = within && mask.dark[4 * (v * mask.width + u)] > 127;
        const s = shadow[y * width + x] > 127;
        if (p && s) both++;
        if (p || s) either++;
      }
    }
    return either ? both / either : 1;
  }

  dispose() {
    this.image.onload = null;
    this.texture?.dispose();
  }
}
