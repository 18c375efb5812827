// What moves on a ground: the rows of one run of a camera, or of all cameras of a site together.
import { passes, state, world } from "./state.js";
import { areaOf, heatMap } from "./scenery.js";
import { flowField } from "./flow.js";
import { Rows } from "./tracks.js";

const RECENT_S = 60;

class Moving {
  constructor() {
    this.version = 0;
    this.kept = null;
  }

  replaceRows(rows) {
    this.rows = rows;
    this.version++;
    this.kept = null;
  }

  // Who is there now and passes the filter.
  there() {
    const { kept, version } = this;
    if (kept && kept.ms === state.ms && kept.version === version && kept.filter === state.filter) return kept.found;
    const found = this.rows.at(state.ms).filter((one) => passes(this.rows.brief[one.k])).map((one) => this.rows.state(one));
    this.kept = { ms: state.ms, version, filter: state.filter, found };
    return found;
  }

  heat() {
    return this.once("heatKept", () => heatMap(this.rows, this.area, passes));
  }

  flow() {
    return this.once("flowKept", () => flowField(this.rows, this.area, passes));
  }

  // Counted over all rows, so only where they or the filter have changed.
  once(name, make) {
    const kept = this[name];
    if (!kept || kept.version !== this.version || kept.filter !== state.filter) {
      this[name] = { version: this.version, filter: state.filter, made: make() };
    }
    return this[name].made;
  }
}

export class Run extends Moving {
  constructor(said, camera, number) {
    super();
    this.said = said;
    this.camera = camera;
    this.number = number;
    this.events = [];
    this.watched = said.watched || [];
    this.viewReady = false;
    this.recent = [];
    this.areaVersion = 0;
    this.replaceRows(new Rows(said.data || { rows: 0, tracks: [] }, said.step_s));
    said.data = null;
  }

  replaceRows(rows) {
    super.replaceRows(rows);
    this.begin = 1000 * Math.min(this.said.begin_s, rows.begin / 1000);
    this.end = Math.max(this.begin + 100, 1000 * this.said.end_s, rows.end);
    if (!this.area || !this.area.whole) {
      this.area = areaOf(rows, this.camera);
      this.area.whole = rows.count > 0;
      this.areaVersion++;
      this.photo = null;
    }
    this.foot = null;
  }

  // What the server says of a run that grows; the last minute tells how many rows come.
  grow({ rows, end_s, version, growing }) {
    this.recent.push([this.said.end_s, this.said.rows]);
    while (this.recent.length > 1 && this.recent[0][0] < end_s - RECENT_S) this.recent.shift();
    Object.assign(this.said, { rows, end_s, version, growing });
  }

  // What was searched for or told of this run, on the page's clock.
  happened() {
    const found = world.searches.flatMap((one) => one.events.filter((event) => event.run === this.said.run && (!event.camera || event.camera === this.said.camera)));
    return [...found, ...this.watched].map((event) => ({ begin: 1000 * (event.site_begin_s ?? event.begin_s + this.said.shift_s) }));
  }

  get rowsPerMinute() {
    const [s, rows] = this.recent[0] || [this.said.begin_s, 0];
    return (60 * (this.said.rows - rows)) / Math.max(1, this.said.end_s - s);
  }

  // Where the places of a track on the ground are seen: pixels of all rows, of which its are right.
  feet(k) {
    const { starts, count, columns: { x_m: x, y_m: y } } = this.rows;
    this.foot ??= { u: new Float32Array(count).fill(NaN), v: new Float32Array(count).fill(NaN), done: new Uint8Array(starts.length) };
    if (this.foot.done[k]) return this.foot;
    this.foot.done[k] = 1;
    for (let i = starts[k]; i < starts[k + 1]; i++) {
      const uv = Number.isFinite(x[i]) ? this.camera.project(x[i], y[i], 0) : null;
      if (uv) [this.foot.u[i], this.foot.v[i]] = uv;
    }
    return this.foot;
  }
}

// Everybody once, as `Site.tracks` fuses what several cameras saw.
export class Together extends Moving {
  constructor(rows, runs) {
    super();
    const edge = (i, of) => of(...runs.map((one) => one.area[i]));
    this.area = [edge(0, Math.min), edge(1, Math.min), edge(2, Math.max), edge(3, Math.max)];
    this.replaceRows(rows);
  }
}
