// What moves on a ground: the rows of one run of a camera, or of all cameras of a site together.
import { passes, state } from "./state.js";
import { areaOf, heatMap } from "./scenery.js";
import { flowField } from "./flow.js";
import { Rows } from "./tracks.js";

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
    this.footUv = null;
  }

  // Where every row's place on the ground is seen.
  feet() {
    if (!this.footUv) {
      const { x_m: x, y_m: y } = this.rows.columns;
      this.footUv = new Float32Array(2 * this.rows.count).fill(NaN);
      for (let i = 0; i < this.rows.count; i++) {
        const uv = Number.isFinite(x[i]) ? this.camera.project(x[i], y[i], 0) : null;
        if (uv) this.footUv.set(uv, 2 * i);
      }
    }
    return this.footUv;
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
