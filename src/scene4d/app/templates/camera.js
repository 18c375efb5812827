// The camera: pixels of the footage and metres on the ground, both ways, with their uncertainty.
// As core/camera.py and core/geometry; tests hold the two against each other.
const LEAST_DEPTH_M = 1e-9;
const WIDEST_RAD = Math.PI / 2 - 1e-6;
const STEPS = 60;

function firstFold(slopes) {
  // The least r > 0 at which 1 + s1 r² + s2 r⁴ + ... is zero; bisection between samples in r.
  if (slopes.every((s) => s >= 0)) return Infinity;
  const value = (r) => slopes.reduceRight((sum, s) => (sum + s) * r * r, 0) + 1;
  let low = 0;
  for (let r = 0.01; r < 1e4; r *= 1.02) {
    if (value(r) <= 0) {
      let high = r;
      for (let i = 0; i < STEPS; i++) {
        const mid = (low + high) / 2;
        if (value(mid) > 0) low = mid; else high = mid;
      }
      return (low + high) / 2;
    }
    low = r;
  }
  return Infinity;
}

function inverse(curve, target, top) {
  let low = 0;
  let high = Math.min(target, top);
  for (let i = 0; i < STEPS && high < top && curve(high)[0] < target; i++) high = Math.min(2 * high, top);
  let r = Math.min(target, high);
  for (let i = 0; i < STEPS; i++) {
    const [value, slope] = curve(r);
    if (value > target) high = r; else low = r;
    let next = r - (value - target) / slope;
    if (!(next >= low && next <= high)) next = (low + high) / 2;
    if (Math.abs(next - r) < 1e-13) return next;
    r = next;
  }
  return r;
}

function bent(x, y, d) {
  const [k1, k2, p1, p2, k3] = d;
  const r2 = x * x + y * y;
  const radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const slope = k1 + r2 * (2 * k2 + 3 * k3 * r2);
  return [
    x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
    y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x,
    2 * x * y * slope + 2 * p1 * x + 2 * p2 * y,
    radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x,
  ];
}

function fisheyeCurve(a, d) {
  const a2 = a * a;
  return [
    a * (1 + a2 * (d[0] + a2 * (d[1] + a2 * (d[2] + a2 * d[3])))),
    1 + a2 * (3 * d[0] + a2 * (5 * d[1] + a2 * (7 * d[2] + a2 * 9 * d[3]))),
  ];
}

function product(A, B) {
  return A.map((row) => B[0].map((_, j) => row.reduce((sum, a, k) => sum + a * B[k][j], 0)));
}

function transposed(A) {
  return A[0].map((_, j) => A.map((row) => row[j]));
}

export function rotationOf(tilt, roll) {
  const c = Math.cos(tilt - Math.PI / 2);
  const s = Math.sin(tilt - Math.PI / 2);
  const cr = Math.cos(roll);
  const sr = Math.sin(roll);
  const overhead = [[1, 0, 0], [0, -1, 0], [0, 0, -1]];
  return product(product([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]], [[1, 0, 0], [0, c, -s], [0, s, c]]), overhead);
}

export function insidePolygon(u, v, corners) {
  let odd = false;
  for (let i = 0, j = corners.length - 1; i < corners.length; j = i++) {
    const [u0, v0] = corners[i];
    const [u1, v1] = corners[j];
    if (v0 > v !== v1 > v && u < u0 + ((v - v0) / (v1 - v0)) * (u1 - u0)) odd = !odd;
  }
  return odd;
}

export class Camera {
  constructor(said) {
    this.said = said;
    this.K = said.K;
    this.d = said.distortion;
    this.R = said.R;
    this.t = said.t;
    this.fisheye = said.distortion_model === "fisheye";
    this.bends = this.d.some((value) => value !== 0);
    this.size = said.image_size;
    this.regions = said.regions || [];
    this.P = product(this.K, this.R.map((row, i) => [...row, this.t[i]]));
    const Rt = transposed(this.R);
    this.centre = Rt.map((row) => -(row[0] * this.t[0] + row[1] * this.t[1] + row[2] * this.t[2]));
    if (this.fisheye) {
      this.reach = Math.min(firstFold([3 * this.d[0], 5 * this.d[1], 7 * this.d[2], 9 * this.d[3]]), Math.PI / 2);
    } else {
      this.fold = firstFold([3 * this.d[0], 5 * this.d[1], 7 * this.d[4]]);
    }
  }

  get up() {
    return this.R.map((row) => row[2]);
  }

  get tilt() {
    return Math.asin(Math.max(-1, Math.min(1, -this.R[2][2])));
  }

  get roll() {
    return Math.atan2(this.R[0][2], -this.R[1][2]);
  }

  normalised(u, v) {
    const y = (v - this.K[1][2]) / this.K[1][1];
    return [(u - this.K[0][2] - this.K[0][1] * y) / this.K[0][0], y];
  }

  pixels(x, y) {
    return [this.K[0][0] * x + this.K[0][1] * y + this.K[0][2], this.K[1][1] * y + this.K[1][2]];
  }

  // Undistorted pixel to pixel of the footage, or null.
  distort(u, v) {
    if (!this.bends && !this.fisheye) return [u, v];
    const [x, y] = this.normalised(u, v);
    const r = Math.hypot(x, y);
    if (this.fisheye) {
      const angle = Math.atan(r);
      if (!(angle < this.reach)) return null;
      const gain = r > 0 ? fisheyeCurve(angle, this.d)[0] / r : 1;
      return this.pixels(x * gain, y * gain);
    }
    const [bx, by, a, b, c] = bent(x, y, this.d);
    return r < this.fold && a * c - b * b > 0 ? this.pixels(bx, by) : null;
  }

  // Pixel of the footage to undistorted pixel, or null.
  undistort(u, v) {
    if (!this.bends && !this.fisheye) return [u, v];
    const [tx, ty] = this.normalised(u, v);
    const target = Math.hypot(tx, ty);
    if (target === 0) return [u, v];
    if (this.fisheye) {
      const reach = Math.min(this.reach, WIDEST_RAD);
      if (!(target < fisheyeCurve(reach, this.d)[0])) return null;
      const gain = Math.tan(inverse((a) => fisheyeCurve(a, this.d), target, reach)) / target;
      return this.pixels(tx * gain, ty * gain);
    }
    const d = this.d;
    const radial = (r) => {
      const r2 = r * r;
      return [
        r * (1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]))),
        1 + r2 * (3 * d[0] + r2 * (5 * d[1] + r2 * 7 * d[4])),
      ];
    };
    const gain = inverse(radial, target, this.fold) / target;
    let x = tx * gain;
    let y = ty * gain;
    for (let i = 0; i < (d[2] || d[3] ? STEPS : 0); i++) {
      const [bx, by, a, b, c] = bent(x, y, d);
      const det = a * c - b * b;
      const dx = (c * (bx - tx) - b * (by - ty)) / det;
      const dy = (a * (by - ty) - b * (bx - tx)) / det;
      x -= dx;
      y -= dy;
      if (!(Math.hypot(dx, dy) > 1e-13)) break;
    }
    const [bx, by, a, b, c] = bent(x, y, d);
    const there = Math.hypot(x, y) < this.fold && a * c - b * b > 0;
    return there && Math.abs(bx - tx) + Math.abs(by - ty) < 1e-9 ? this.pixels(x, y) : null;
  }

  // World point (m) to pixel of the footage, or null.
  project(x, y, z = 0) {
    const P = this.P;
    const w = P[2][0] * x + P[2][1] * y + P[2][2] * z + P[2][3];
    if (!(w > LEAST_DEPTH_M)) return null;
    const u = (P[0][0] * x + P[0][1] * y + P[0][2] * z + P[0][3]) / w;
    const v = (P[1][0] * x + P[1][1] * y + P[1][2] * z + P[1][3]) / w;
    return this.distort(u, v);
  }

  groundHeight(u, v) {
    const region = this.regions.find((one) => insidePolygon(u, v, one.polygon_uv));
    return region ? [region.height_m, region.sigma_m] : [0, 0];
  }

  // Pixel of the footage to the point (m) of the plane at a height (that of the ground there).
  locate(u, v, height = null) {
    const straight = this.undistort(u, v);
    if (straight === null) return null;
    return this.meet(straight[0], straight[1], height === null ? this.groundHeight(u, v)[0] : height);
  }

  meet(u, v, z) {
    const P = this.P;
    const o = [0, 1, 2].map((i) => P[i][2] * z + P[i][3]);
    const a = P[0][0] - u * P[2][0];
    const b = P[0][1] - u * P[2][1];
    const c = P[1][0] - v * P[2][0];
    const d = P[1][1] - v * P[2][1];
    const e = u * o[2] - o[0];
    const f = v * o[2] - o[1];
    const det = a * d - b * c;
    const x = (e * d - b * f) / det;
    const y = (a * f - e * c) / det;
    const depth = P[2][0] * x + P[2][1] * y + o[2];
    const across = (i, w) => Math.abs(P[i][0]) + Math.abs(w * P[2][0]);
    const along = (i, w) => Math.abs(P[i][1]) + Math.abs(w * P[2][1]);
    const size = across(0, u) * along(1, v) + across(1, v) * along(0, u);
    return Math.abs(det) > 1e-12 * size && depth > LEAST_DEPTH_M ? [x, y] : null;
  }

  // The camera changed by (log f, tilt, roll, log height, corner distortion, principal point).
  disturbed(step) {
    const stretch = Math.exp(step[0]);
    const half = Math.hypot(...this.size) / 2;
    const K = this.K.map((row) => [...row]);
    for (const i of [0, 1]) for (const j of [0, 1]) K[i][j] *= stretch;
    const powers = this.fisheye ? [2, 4, 6, 8] : [2, 4, 1, 1, 6];
    const d = this.d.map((value, i) => value * stretch ** powers[i]);
    K[0][2] += (step[5] || 0) * half;
    K[1][2] += (step[6] || 0) * half;
    d[0] += step[4] * (K[0][0] / half) ** 2;
    const before = rotationOf(this.tilt, this.roll);
    const R = product(product(rotationOf(this.tilt + step[1], this.roll + step[2]), transposed(before)), this.R);
    const C = [this.centre[0], this.centre[1], this.centre[2] * Math.exp(step[3])];
    const t = R.map((row) => -(row[0] * C[0] + row[1] * C[1] + row[2] * C[2]));
    return new Camera({ ...this.said, K, distortion: d, R, t });
  }

  get neighbours() {
    if (!this._neighbours) {
      const h = 1e-5;
      this._neighbours = [0, 1, 2, 3, 4, 5, 6].map((k) =>
        [h, -h].map((value) => this.disturbed([0, 0, 0, 0, 0, 0, 0].map((_, i) => (i === k ? value : 0)))),
      );
      this._neighbours.step = h;
    }
    return this._neighbours;
  }

  // Derivatives of a function of a camera (numbers) by its seven parameters: rows of values.
  slopes(of) {
    return this.neighbours.map(([ahead, behind]) => {
      const a = of(ahead);
      const b = of(behind);
      return a && b ? a.map((value, i) => (value - b[i]) / (2 * this.neighbours.step)) : null;
    });
  }

  // Variance of each value of `of` (numbers) that the camera's own errors cause; null if unknown.
  variances(of) {
    const covariance = this.said.covariance;
    if (!covariance) return null;
    const J = this.slopes(of);
    if (J.some((row) => row === null)) return null;
    return J[0].map((_, i) => {
      let sum = 0;
      for (let k = 0; k < 7; k++) for (let l = 0; l < 7; l++) sum += J[k][i] * covariance[k][l] * J[l][i];
      return Math.max(sum, 0);
    });
  }

  // Standard deviation of a length made of pixels: the camera's share and that of clicks of 1 px.
  sigma(of, pixels, clickPx = 1) {
    const own = this.variances((camera) => {
      const value = of(camera, pixels);
      return value === null ? null : [value];
    });
    let clicks = 0;
    for (let i = 0; i < pixels.length; i++) {
      for (const axis of [0, 1]) {
        const moved = [1, -1].map((sign) =>
          of(this, pixels.map((p, j) => (j === i ? p.map((value, k) => value + (k === axis ? 0.5 * sign : 0)) : p))),
        );
        if (moved[0] === null || moved[1] === null) return { camera: null, clicks: null, total: null };
        clicks += ((moved[0] - moved[1]) * clickPx) ** 2;
      }
    }
    const camera = own === null ? null : Math.sqrt(own[0]);
    return { camera, clicks: Math.sqrt(clicks), total: camera === null ? null : Math.sqrt(own[0] + clicks) };
  }

  // Pixels (undistorted) of the horizon as a line a u + b v + c = 0.
  get horizon() {
    const up = this.up;
    const [[fx, s, cx], [, fy, cy]] = this.K;
    const a = up[0] / fx;
    const b = (up[1] - s * a) / fy;
    return [a, b, up[2] - cx * a - cy * b];
  }
}

export function distanceBetween(camera, [a, b], heights = null) {
  const p = camera.locate(...a, heights && heights[0]);
  const q = camera.locate(...b, heights && heights[1]);
  return p && q ? Math.hypot(p[0] - q[0], p[1] - q[1]) : null;
}

const TALLEST_M = 20;

// How tall an upright is whose foot and top are seen there.
export function heightBetween(camera, [foot, top]) {
  const place = camera.locate(...foot);
  if (!place) return null;
  const off = (z) => {
    const uv = camera.project(...place, z);
    return uv ? Math.hypot(uv[0] - top[0], uv[1] - top[1]) : Infinity;
  };
  let [low, high] = [0, TALLEST_M];
  for (let i = 0; i < 60; i++) {
    const [a, b] = [low + (high - low) / 3, high - (high - low) / 3];
    if (off(a) <= off(b)) high = b;
    else low = a;
  }
  return (low + high) / 2;
}

export function distanceFrom(camera, [a]) {
  const p = camera.locate(...a);
  return p ? Math.hypot(p[0] - camera.centre[0], p[1] - camera.centre[1]) : null;
}
