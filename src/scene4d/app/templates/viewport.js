// A canvas that can be moved and zoomed, sharp on every screen.
import { draw, state } from "./state.js";

const MOST_ZOOM = 60;
const REST_MS = 120; // after a gesture drawings are made anew, until then they are stretched
const APART_PX = 1.5;

export class Viewport {
  // `fit` gives what is to be seen as [x0, y0, x1, y1]; y points down in these units.
  constructor(canvas, fit) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.fit = fit;
    this.zoom = 1;
    this.shift = [0, 0];
    this.version = 0;
    this.resting = null;
    new ResizeObserver(() => this.resized()).observe(canvas);
    this.listen();
  }

  resized() {
    const box = this.canvas.getBoundingClientRect();
    this.dpr = Math.min(window.devicePixelRatio || 1, 2);
    this.width = box.width;
    this.height = box.height;
    const [w, h] = [Math.round(box.width * this.dpr), Math.round(box.height * this.dpr)];
    if (this.canvas.width !== w || this.canvas.height !== h) {
      this.canvas.width = w;
      this.canvas.height = h;
    }
    this.changed();
  }

  changed() {
    this.version++;
    if (!this.width) return;
    const [x0, y0, x1, y1] = this.fit();
    const base = Math.min(this.width / (x1 - x0), this.height / (y1 - y0));
    this.scale = base * this.zoom;
    this.origin = [
      this.width / 2 - this.scale * ((x0 + x1) / 2 + this.shift[0]),
      this.height / 2 - this.scale * ((y0 + y1) / 2 + this.shift[1]),
    ];
    draw();
  }

  reset() {
    this.zoom = 1;
    this.shift = [0, 0];
    this.changed();
  }

  to(x, y) {
    return [this.origin[0] + this.scale * x, this.origin[1] + this.scale * y];
  }

  from(px, py) {
    return [(px - this.origin[0]) / this.scale, (py - this.origin[1]) / this.scale];
  }

  zoomAt(px, py, factor) {
    const before = this.from(px, py);
    this.zoom = Math.min(MOST_ZOOM, Math.max(0.25, this.zoom * factor));
    this.changed();
    const after = this.from(px, py);
    this.shift = this.shift.map((value, i) => value + before[i] - after[i]);
    this.gesture();
    this.changed();
  }

  pan(dx, dy) {
    this.shift = [this.shift[0] - dx / this.scale, this.shift[1] - dy / this.scale];
    this.gesture();
    this.changed();
  }

  gesture() {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => {
      this.resting = null;
      draw();
    }, REST_MS);
  }

  // Rows of a track as part of a path; points that fall on one another are left out.
  trace(context, xs, ys, first, last, down) {
    const [ox, oy] = this.origin;
    const [sx, sy] = [this.scale, this.scale * down];
    let [drawing, ax, ay] = [false, 0, 0];
    for (let i = first; i < last; i++) {
      const x = ox + sx * xs[i];
      const y = oy + sy * ys[i];
      if (x !== x) { // NaN: not on the ground
        drawing = false;
        continue;
      }
      if (drawing && Math.abs(x - ax) + Math.abs(y - ay) < APART_PX && i + 1 < last) continue;
      if (drawing) context.lineTo(x, y); else context.moveTo(x, y);
      drawing = true;
      ax = x;
      ay = y;
    }
  }

  listen() {
    const canvas = this.canvas;
    const at = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    this.at = at;
    canvas.addEventListener("wheel", (event) => {
      if (matchMedia("(max-width: 1099px)").matches && !event.ctrlKey) return; // the page scrolls
      event.preventDefault();
      this.zoomAt(...at(event), Math.exp(-event.deltaY / 400));
    }, { passive: false });
    const fingers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      fingers.set(event.pointerId, at(event));
      this.dragged = false;
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) return;
      const [before, now] = [fingers.get(event.pointerId), at(event)];
      if (fingers.size === 2) this.pinch(fingers, event.pointerId, now);
      else if (event.pointerType !== "touch" && (state.tool === "look" || event.buttons === 4) && !this.held) {
        if (this.dragged || Math.hypot(now[0] - before[0], now[1] - before[1]) > 4) {
          this.dragged = true;
          this.pan(now[0] - before[0], now[1] - before[1]);
        } else return;
      }
      fingers.set(event.pointerId, now);
    });
    for (const name of ["pointerup", "pointercancel", "pointerleave"]) {
      canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
    }
    canvas.addEventListener("dblclick", () => state.tool === "look" && this.reset());
  }

  pinch(fingers, id, now) {
    const other = [...fingers].find(([key]) => key !== id)[1];
    const before = fingers.get(id);
    const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
    if (apart(before) > 0) this.zoomAt(...other, apart(now) / apart(before));
  }

  begin() {
    const context = this.context;
    context.setTransform(this.dpr, 0, 0, this.dpr, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    context.lineJoin = context.lineCap = "round";
    return context;
  }
}
