// Drawings that are kept: made again only where what they show has changed, and then a little in
// each frame, so that a million rows stop nothing. Until a drawing is done the last one is shown,
// moved and stretched as the view was.
import { draw, passes } from "./state.js";

const BUDGET_MS = 6; // of a frame of 16 ms, in which two panes are drawn

export class Cached {
  constructor(view) {
    this.view = view;
    this.front = null;
    this.back = null;
    this.spare = null;
  }

  // `paint` is a generator function that yields now and then; `owner` is whose drawing it is, since
  // that of another must not be shown meanwhile.
  show(owner, key, paint) {
    const { view } = this;
    if (this.back && (this.back.owner !== owner || this.back.version !== view.version)) this.drop();
    if (this.front && this.front.owner !== owner) this.front = null;
    if (!this.back) {
      const right = this.front && this.front.key === key && fits(this.front, view);
      const moved = this.front && this.front.version !== view.version && view.resting === null;
      if (!right || moved) this.begin(owner, key, paint);
    }
    if (this.back) this.go();
    this.copy(this.front || this.back);
  }

  begin(owner, key, paint) {
    const { view } = this;
    const canvas = this.spare || document.createElement("canvas");
    [canvas.width, canvas.height] = [view.canvas.width, view.canvas.height];
    const context = canvas.getContext("2d");
    context.setTransform(view.dpr, 0, 0, view.dpr, 0, 0);
    context.lineJoin = context.lineCap = "round";
    const { version, scale, origin } = view;
    this.back = { owner, key, version, scale, origin, canvas, work: paint(context) };
    this.spare = null;
  }

  drop() {
    this.spare = this.back.canvas;
    this.back = null;
  }

  go() {
    const until = performance.now() + BUDGET_MS;
    while (!this.back.work.next().done) if (performance.now() > until) return draw();
    this.spare = this.front && this.front.canvas;
    this.front = this.back;
    this.back = null;
    return undefined;
  }

  copy({ canvas, scale, origin }) {
    const { context, dpr, scale: now, origin: [x, y] } = this.view;
    const by = now / scale;
    context.save();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(canvas, dpr * (x - by * origin[0]), dpr * (y - by * origin[1]), by * canvas.width, by * canvas.height);
    context.restore();
  }
}

const fits = ({ canvas }, view) => canvas.width === view.canvas.width && canvas.height === view.canvas.height;

const AT_ONCE = 4000; // rows of one path: longer ones are slow to fill in

// The tracks that pass, as one path for each colour, some thousand rows at a time. `trace` adds a
// track, by its number, to the path.
export function* strokeTracks(context, rows, tints, trace) {
  const kinds = Object.keys(tints);
  let first = 0;
  while (first < rows.brief.length) {
    let last = first;
    const begin = rows.starts[first];
    while (last < rows.brief.length && rows.starts[last] - begin < AT_ONCE) last++;
    for (const kind of kinds) {
      context.beginPath();
      context.strokeStyle = tints[kind];
      for (let k = first; k < last; k++) if (rows.brief[k].kind === kind && passes(rows.brief[k])) trace(k);
      context.stroke();
    }
    first = last;
    yield;
  }
}
