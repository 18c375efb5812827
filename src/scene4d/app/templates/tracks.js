// The rows of a run: who is where at a moment, and each track in brief.
import { bytesOf, floats, int32 } from "./packed.js";
import { insidePolygon } from "./camera.js";
import { placesHere } from "./places.js";

export const KINDS = {
  person: "person", bicycle: "wheels", motorcycle: "wheels",
  car: "vehicle", truck: "vehicle", bus: "vehicle", vehicle: "vehicle",
};
const BUCKET_MS = 1000;

export class Rows {
  constructor(packed, stepS) {
    this.step = Math.max(50, 1000 * stepS);
    this.count = packed.rows;
    this.tracks = packed.tracks;
    this.starts = this.count ? int32(packed.starts) : new Int32Array(1);
    this.time = this.count ? int32(packed.time_ms) : new Int32Array(0);
    this.observed = this.count ? bytesOf(packed.observed) : new Uint8Array(0);
    this.columns = {};
    for (const [name, column] of Object.entries(packed.columns || {})) this.columns[name] = floats(column);
    this.index();
  }

  // Tracks by second, and what is known of each.
  index() {
    this.brief = this.tracks.map((track, k) => this.summary(track, k));
    this.begin = this.brief.reduce((least, one) => Math.min(least, one.begin), Infinity);
    this.end = this.brief.reduce((most, one) => Math.max(most, one.end), -Infinity);
    this.buckets = new Map();
    this.brief.forEach((one, k) => {
      for (let s = Math.floor(one.begin / BUCKET_MS); s <= Math.floor((one.end + this.step) / BUCKET_MS); s++) {
        if (!this.buckets.has(s)) this.buckets.set(s, []);
        this.buckets.get(s).push(k);
      }
    });
    this.byNumber = new Map(this.tracks.map((track, k) => [track.track, k]));
  }

  summary(track, k) {
    const [first, last] = [this.starts[k], this.starts[k + 1] - 1];
    const { x_m: x, y_m: y, vx_mps: vx, vy_mps: vy } = this.columns;
    let path = 0;
    let fastest = 0;
    let seen = 0;
    let sum = 0;
    let known = 0;
    for (let i = first; i <= last; i++) {
      if (i > first) {
        const step = Math.hypot(x[i] - x[i - 1], y[i] - y[i - 1]);
        if (step > 0) path += step;
      }
      const speed = Math.hypot(vx[i], vy[i]);
      if (speed >= 0) {
        fastest = Math.max(fastest, speed);
        sum += speed;
        known++;
      }
      seen += this.observed[i];
    }
    return {
      ...track, k, kind: KINDS[track.class] || "vehicle",
      begin: this.time[first], end: this.time[last], path, fastest, wasIn: (zone) => this.wasIn(k, zone),
      speed: known ? sum / known : NaN, seen: seen / (last - first + 1),
    };
  }

  // Whether a track was on the ground of a zone.
  wasIn(k, name) {
    const zone = placesHere().find((place) => place.kind === "zone" && place.name === name);
    if (!zone) return false;
    const { x_m: x, y_m: y } = this.columns;
    for (let i = this.starts[k]; i < this.starts[k + 1]; i++) if (insidePolygon(x[i], y[i], zone.points)) return true;
    return false;
  }

  // The tracks that are there at a moment: k, the row before, and the share of the way to the next.
  at(ms) {
    const found = [];
    for (const k of this.buckets.get(Math.floor(ms / BUCKET_MS)) || []) {
      const one = this.sample(k, ms);
      if (one) found.push(one);
    }
    return found;
  }

  sample(k, ms) {
    let low = this.starts[k];
    let high = this.starts[k + 1] - 1;
    if (ms < this.time[low] || ms > this.time[high] + this.step / 2) return null;
    while (low < high) {
      const mid = (low + high + 1) >> 1;
      if (this.time[mid] <= ms) low = mid; else high = mid - 1;
    }
    const next = low + 1 < this.starts[k + 1] ? low + 1 : low;
    const gap = this.time[next] - this.time[low];
    if (gap > 3 * this.step && ms - this.time[low] > this.step) return null;
    return { k, row: low, next, share: gap > 0 ? Math.min(1, (ms - this.time[low]) / gap) : 0 };
  }

  value(name, one) {
    const column = this.columns[name];
    const [a, b] = [column[one.row], column[one.next]];
    return Number.isFinite(b) ? a + one.share * (b - a) : a;
  }

  // Everything that is drawn of a track at a moment.
  state(one) {
    const get = (name) => this.value(name, one);
    const brief = this.brief[one.k];
    const heading = this.columns.heading_rad[one.row];
    return {
      ...one, brief, observed: this.observed[one.row] === 1,
      xy: [get("x_m"), get("y_m")],
      box: [get("x1"), get("y1"), get("x2"), get("y2")],
      velocity: [get("vx_mps"), get("vy_mps")], heading,
      own: [get("own_x"), get("own_y"), get("own_correlation")],
      whole: [get("whole_x"), get("whole_y"), get("whole_correlation")],
    };
  }

  // How many of each kind are there, in equal steps of time.
  counts(begin, end, bins) {
    const kinds = { person: new Uint16Array(bins), wheels: new Uint16Array(bins), vehicle: new Uint16Array(bins) };
    const width = (end - begin) / bins;
    for (const one of this.brief) {
      const first = Math.max(0, Math.floor((one.begin - begin) / width));
      const last = Math.min(bins - 1, Math.floor((one.end - begin) / width));
      for (let i = first; i <= last; i++) kinds[one.kind][i]++;
    }
    return kinds;
  }

  // These rows without those from a moment on, and others instead.
  merged(later, sinceMs) {
    const kept = new Map();
    const pieces = (rows, keep) => {
      rows.tracks.forEach((track, k) => {
        if (!kept.has(track.track)) kept.set(track.track, { track, parts: [] });
        const one = kept.get(track.track);
        one.track = track;
        let [a, b] = [rows.starts[k], rows.starts[k + 1]];
        if (keep) while (b > a && rows.time[b - 1] >= sinceMs) b--;
        if (b > a) one.parts.push([rows, a, b]);
      });
    };
    pieces(this, true);
    pieces(later, false);
    const all = [...kept.values()].filter((one) => one.parts.length).sort((a, b) => a.track.track - b.track.track);
    return this.joined(all);
  }

  joined(all) {
    const result = Object.create(Rows.prototype);
    const total = all.reduce((sum, one) => sum + one.parts.reduce((n, [, a, b]) => n + b - a, 0), 0);
    Object.assign(result, { step: this.step, count: total, tracks: all.map((one) => one.track) });
    result.starts = new Int32Array(all.length + 1);
    result.time = new Int32Array(total);
    result.observed = new Uint8Array(total);
    const source = all.length ? all[0].parts[0][0].columns : {};
    result.columns = Object.fromEntries(Object.keys(source).map((name) => [name, new Float32Array(total)]));
    let at = 0;
    all.forEach((one, k) => {
      for (const [rows, a, b] of one.parts) {
        result.time.set(rows.time.subarray(a, b), at);
        result.observed.set(rows.observed.subarray(a, b), at);
        for (const name of Object.keys(source)) result.columns[name].set(rows.columns[name].subarray(a, b), at);
        at += b - a;
      }
      result.starts[k + 1] = at;
    });
    result.index();
    return result;
  }
}
