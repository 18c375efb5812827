// What does not move: the grid and horizon in the picture, the heat map, and the ground as a photo.
import { state } from "./state.js";
import { niceStep } from "./look.js";

const HEAT_CELL_M = 0.5;
// From faint to strong for every eye: the yellow to brown of the bands in drawing/style.py.
const HEAT = [[254, 221, 127], [254, 174, 69], [244, 98, 43], [201, 22, 29], [110, 0, 40]];

const PALE = 0.45; // so much greyer than the footage: colours on the plan are those of tracks

// Lines of the ground's grid as pixels of the footage, each a list of pieces.
export function gridLines(camera, area) {
  const [x0, y0, x1, y1] = area;
  const step = niceStep(Math.max(x1 - x0, y1 - y0) / 14);
  const lines = [];
  const along = (from, to, values, make) => {
    for (let value = Math.ceil(from / step) * step; value <= to; value += step) {
      lines.push(curve(values.map((other) => camera.project(...make(value, other)))));
    }
  };
  const span = (a, b) => Array.from({ length: 121 }, (_, i) => a + ((b - a) * i) / 120);
  along(x0, x1, span(y0, y1), (x, y) => [x, y, 0]);
  along(y0, y1, span(x0, x1), (y, x) => [x, y, 0]);
  return { step, lines };
}

function curve(points) {
  const pieces = [[]];
  for (const point of points) {
    if (point) pieces[pieces.length - 1].push(point);
    else if (pieces[pieces.length - 1].length) pieces.push([]);
  }
  return pieces.filter((piece) => piece.length > 1);
}

// The horizon as the lens shows it.
export function horizonCurve(camera, horizon = camera.horizon) {
  const [a, b, c] = horizon;
  const [width, height] = camera.size;
  const steep = Math.abs(b) < Math.abs(a);
  const points = [];
  for (let i = -40; i <= 140; i++) {
    const along = ((steep ? height : width) * i) / 100;
    const other = steep ? -(b * along + c) / a : -(a * along + c) / b;
    points.push(camera.distort(...(steep ? [other, along] : [along, other])));
  }
  return curve(points);
}

// Seconds that somebody spent in each cell of the ground.
export function heatMap(rows, area, passes) {
  const [x0, y0, x1, y1] = area;
  const [w, h] = [x1 - x0, y1 - y0].map((side) => Math.max(1, Math.min(800, Math.ceil(side / HEAT_CELL_M))));
  const seconds = new Float32Array(w * h);
  const { x_m: x, y_m: y } = rows.columns;
  for (const one of rows.brief) {
    if (!passes(one)) continue;
    for (let i = rows.starts[one.k]; i < rows.starts[one.k + 1]; i++) {
      const column = Math.floor((x[i] - x0) / HEAT_CELL_M);
      const row = Math.floor((y1 - y[i]) / HEAT_CELL_M);
      if (column >= 0 && column < w && row >= 0 && row < h) seconds[row * w + column] += rows.step / 1000;
    }
  }
  const sorted = seconds.filter((value) => value > 0).sort();
  const most = sorted.length ? sorted[Math.floor(0.98 * (sorted.length - 1))] : 1;
  return { canvas: heatCanvas(seconds, w, h, most), most: most / HEAT_CELL_M ** 2 };
}

function heatCanvas(seconds, w, h, most) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [w, h];
  const image = new ImageData(w, h);
  seconds.forEach((value, i) => {
    if (!(value > 0)) return;
    const share = Math.min(1, Math.sqrt(value / most)) * (HEAT.length - 1);
    const low = Math.min(HEAT.length - 2, Math.floor(share));
    for (let k = 0; k < 3; k++) image.data[4 * i + k] = HEAT[low][k] + (share - low) * (HEAT[low + 1][k] - HEAT[low][k]);
    image.data[4 * i + 3] = 130 + 110 * (share / (HEAT.length - 1));
  });
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

// The empty view as it looks from straight above.
export function groundPhoto(camera, view, area) {
  const [width, height] = camera.size;
  const source = document.createElement("canvas");
  [source.width, source.height] = [view.naturalWidth, view.naturalHeight];
  const context = source.getContext("2d", { willReadFrequently: true });
  context.drawImage(view, 0, 0);
  const pixels = context.getImageData(0, 0, source.width, source.height);
  const [sx, sy] = [source.width / width, source.height / height];
  const [x0, y0, x1, y1] = area;
  const cell = Math.max(x1 - x0, y1 - y0) / 900;
  const [w, h] = [Math.ceil((x1 - x0) / cell), Math.ceil((y1 - y0) / cell)];
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [w, h];
  const image = new ImageData(w, h);
  for (let row = 0; row < h; row++) {
    for (let column = 0; column < w; column++) {
      const uv = camera.project(x0 + (column + 0.5) * cell, y1 - (row + 0.5) * cell, 0);
      if (!uv) continue;
      const u = Math.round((uv[0] + 0.5) * sx - 0.5);
      const v = Math.round((uv[1] + 0.5) * sy - 0.5);
      if (u < 0 || v < 0 || u >= source.width || v >= source.height) continue;
      const [from, to] = [4 * (v * source.width + u), 4 * (row * w + column)];
      const grey = (pixels.data[from] + pixels.data[from + 1] + pixels.data[from + 2]) / 3;
      for (let k = 0; k < 3; k++) image.data[to + k] = PALE * grey + (1 - PALE) * pixels.data[from + k];
      image.data[to + 3] = 255;
    }
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

// The ground that a plan shows: where 98 % of the rows are, with the camera and a margin.
export function areaOf(rows, camera) {
  const { x_m: x, y_m: y } = rows.columns;
  const step = Math.max(1, Math.floor(rows.count / 20000));
  const [xs, ys] = [[], []];
  for (let i = 0; i < rows.count; i += step) {
    if (Number.isFinite(x[i])) {
      xs.push(x[i]);
      ys.push(y[i]);
    }
  }
  if (!xs.length) return [camera.centre[0] - 10, camera.centre[1] - 2, camera.centre[0] + 10, camera.centre[1] + 30];
  const span = (values, also) => {
    values.sort((a, b) => a - b);
    const at = (share) => values[Math.round(share * (values.length - 1))];
    const [low, high] = [Math.min(at(0.01), also), Math.max(at(0.99), also)];
    const margin = 0.06 * (high - low) + 1;
    return [low - margin, high + margin];
  };
  const [x0, x1] = span(xs, camera.centre[0]);
  const [y0, y1] = span(ys, camera.centre[1]);
  return [x0, y0, x1, y1];
}

export function layer(name) {
  return state.layers[name];
}
