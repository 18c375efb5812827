// The footage with what is known drawn over it.
import { $, isChosen, isLit, on, run, state } from "./state.js";
import { Viewport } from "./viewport.js";
import { Cached, strokeTracks } from "./cached.js";
import { ON_PICTURE, halo, label } from "./look.js";
import { gridLines, horizonCurve, layer } from "./scenery.js";
import { flowLegend, paintFlow } from "./flow.js";
import { marksInPicture } from "./tools.js";
import { triedCamera } from "./judge.js";

const NEAR_PX = 26;
const TRAIL_MS = 4000;
let view = null;
let paths = null;
let scene = null;
let flow = null;

export function startPicture() {
  const canvas = $("picture");
  view = new Viewport(canvas, () => {
    const [width, height] = run() ? run().camera.size : [4, 3];
    return [-0.5, -0.5, width - 0.5, height - 0.5];
  });
  paths = new Cached(view);
  scene = new Cached(view);
  flow = new Cached(view);
  on("run", () => view.reset());
  on("draw", paintPicture);
  return view;
}

export const pictureView = () => view;

function paintPicture() {
  const now = run();
  if (!now || !view.width) return;
  const context = view.begin();
  paintFrame(context, now);
  if (layer("grid") || seesHorizon()) {
    triedCamera();
    const key = `${layer("grid")} ${seesHorizon()} ${now.areaVersion} ${state.tried ? state.tried.key : ""}`;
    scene.show(now, key, (made) => paintScene(made, now));
  }
  const what = `${now.version} ${JSON.stringify(state.filter)}`;
  if (layer("paths")) paths.show(now, what, (made) => paintPaths(made, now));
  if (layer("flow")) {
    flow.show(now, what, (made) => paintStreams(made, now));
    flowLegend(context, now.flow(), 10, 26);
  }
  const there = now.there();
  if (layer("paths")) there.forEach((one) => paintTrail(context, now, one));
  for (const one of there) paintOne(context, now, one);
  marksInPicture(context, view, now);
}

const seesHorizon = () => layer("horizon") || state.tool === "judge";

function paintFrame(context, now) {
  const [width, height] = now.camera.size;
  const [x, y] = view.to(-0.5, -0.5);
  const [w, h] = [width * view.scale, height * view.scale];
  const picture = now.video && now.video.readyState >= 2 ? now.video : now.view;
  context.fillStyle = "#20262d";
  context.fillRect(x, y, w, h);
  if (picture) context.drawImage(picture, x, y, w, h);
}

function trace(context, points) {
  let drawing = false;
  context.beginPath();
  for (const uv of points) {
    if (!uv) {
      drawing = false;
      continue;
    }
    const [x, y] = view.to(...uv);
    if (drawing) context.lineTo(x, y); else context.moveTo(x, y);
    drawing = true;
  }
}

function* paintScene(context, now) {
  const camera = triedCamera() || now.camera;
  context.globalAlpha = 0.5;
  context.lineWidth = 1;
  context.strokeStyle = "#fff";
  if (layer("grid")) {
    for (const pieces of gridLines(camera, now.area).lines) {
      for (const piece of pieces) {
        trace(context, piece);
        context.stroke();
      }
    }
  }
  context.globalAlpha = 1;
  if (!seesHorizon()) return;
  context.strokeStyle = state.tried ? "#ffc845" : "#5fe3e8";
  context.lineWidth = 2;
  for (const piece of horizonCurve(camera)) {
    trace(context, piece);
    halo(context, () => context.stroke());
  }
}

function* paintPaths(context, now) {
  context.lineWidth = 1.1;
  context.globalAlpha = 0.34;
  yield* strokeTracks(context, now.rows, ON_PICTURE, (k) => traceFeet(context, now, k, now.rows.starts[k], now.rows.starts[k + 1]));
}

function traceFeet(context, now, k, first, last) {
  const { u, v } = now.feet(k);
  view.trace(context, u, v, first, last, 1);
}

function* paintStreams(context, now) {
  paintFlow(context, now.flow(), (x, y) => {
    const uv = now.camera.project(x, y, 0);
    return uv && view.to(...uv);
  });
}

function paintTrail(context, now, one) {
  const { rows } = now;
  let first = one.row;
  const whole = isChosen(one.brief.track);
  while (first > rows.starts[one.k] && (whole || rows.time[first] > state.ms - TRAIL_MS)) first--;
  const last = whole ? rows.starts[one.k + 1] : one.row + 1;
  context.strokeStyle = ON_PICTURE[one.brief.kind];
  context.lineWidth = 2.2;
  context.beginPath();
  traceFeet(context, now, one.k, first, last);
  context.stroke();
}

function paintOne(context, now, one) {
  const tint = ON_PICTURE[one.brief.kind];
  context.strokeStyle = context.fillStyle = tint;
  context.lineWidth = isLit(one.brief.track) ? 3 : 1.7;
  context.setLineDash(one.observed ? [] : [4, 4]);
  if (layer("boxes") && Number.isFinite(one.box[0])) paintBox(context, one.box);
  if (layer("cuboids")) paintCuboid(context, now.camera, one);
  if (layer("uprights") && one.brief.kind === "person") paintUpright(context, triedCamera() || now.camera, one, now);
  context.setLineDash([]);
  if (layer("sigma")) paintSigma(context, now.camera, one);
  const foot = now.camera.project(...one.xy, 0);
  if (layer("feet") && foot) paintFoot(context, foot, isLit(one.brief.track));
  if (isLit(one.brief.track)) {
    const [x, y] = view.to(...(Number.isFinite(one.box[0]) ? one.box : foot || [0, 0]));
    label(context, `${one.brief.class} ${one.brief.track}`, x, y - 3);
  }
}

function paintBox(context, [x1, y1, x2, y2]) {
  const [a, b] = view.to(x1, y1);
  const [c, d] = view.to(x2, y2);
  context.beginPath();
  context.roundRect(a, b, c - a, d - b, 3);
  halo(context, () => context.stroke(), 2);
}

function paintFoot(context, uv, lit) {
  const [x, y] = view.to(...uv);
  context.beginPath();
  context.ellipse(x, y, lit ? 6 : 4, lit ? 3.6 : 2.4, 0, 0, 7);
  context.fill();
  context.lineWidth = 1;
  context.strokeStyle = "#fff";
  context.stroke();
}

export function cornersOf(one) {
  const { length_m: l, width_m: w, height_m: h } = one.brief;
  if (one.brief.kind === "person" || ![l, w, h, one.heading, one.xy[0]].every(Number.isFinite)) return null;
  const [c, s] = [Math.cos(one.heading), Math.sin(one.heading)];
  return [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([a, b]) => [
    one.xy[0] + (a * l * c) / 2 - (b * w * s) / 2, one.xy[1] + (a * l * s) / 2 + (b * w * c) / 2, h,
  ]);
}

function paintCuboid(context, camera, one) {
  const corners = cornersOf(one);
  if (corners === null) {
    if (Number.isFinite(one.brief.height_m)) segment(context, camera, one.xy, 0, one.brief.height_m);
    return;
  }
  const [low, high] = [0, 1].map((share) => corners.map(([x, y, h]) => camera.project(x, y, share * h)));
  const edges = [0, 1, 2, 3].flatMap((i) => [[low[i], low[(i + 1) % 4]], [high[i], high[(i + 1) % 4]], [low[i], high[i]]]);
  for (const [a, b] of edges) {
    if (!a || !b) continue;
    trace(context, [a, b]);
    halo(context, () => context.stroke(), 1.5);
  }
}

function segment(context, camera, xy, low, high) {
  const ends = [camera.project(...xy, low), camera.project(...xy, high)];
  if (!ends[0] || !ends[1]) return;
  trace(context, ends);
  halo(context, () => context.stroke(), 2);
}

function paintUpright(context, camera, one, now) {
  const foot = now.camera.project(...one.xy, 0);
  const place = foot && camera.locate(...foot);
  if (!place) return;
  context.strokeStyle = "#ffc845";
  segment(context, camera, place, 0, now.camera.said.person_height_m);
}

// Filled: by its own errors. Dashed: with those of the camera, which move everybody alike.
function paintSigma(context, camera, one) {
  for (const [kind, dashes] of [["whole", [3, 4]], ["own", []]]) {
    const ring = ellipse(one, one[kind], 24);
    if (!ring) continue;
    context.lineWidth = 1.5;
    context.setLineDash(dashes);
    trace(context, ring.map(([x, y]) => camera.project(x, y, 0)));
    context.globalAlpha = 0.3;
    if (kind === "own") context.fill();
    context.globalAlpha = 1;
    context.stroke();
  }
  context.setLineDash([]);
}

// The ground on which somebody is with a probability of 95 %.
export function ellipse(one, [sx, sy, r], points) {
  if (![sx, sy, r, one.xy[0]].every(Number.isFinite)) return null;
  const reach = Math.sqrt(-2 * Math.log(0.05));
  const rest = Math.sqrt(Math.max(0, 1 - r * r));
  return Array.from({ length: points + 1 }, (_, i) => {
    const [c, s] = [Math.cos((2 * Math.PI * i) / points), Math.sin((2 * Math.PI * i) / points)];
    return [one.xy[0] + reach * sx * c, one.xy[1] + reach * sy * (r * c + rest * s)];
  });
}

// Whose box the pointer is in, the smallest of them; or whose foot is near.
export function trackInPicture(now, px, py) {
  const [u, v] = view.from(px, py);
  let [found, least] = [null, Infinity];
  for (const one of now.there()) {
    const [x1, y1, x2, y2] = one.box;
    const inside = u >= x1 && u <= x2 && v >= y1 && v <= y2;
    const foot = now.camera.project(...one.xy, 0);
    const away = foot ? view.scale * Math.hypot(foot[0] - u, foot[1] - v) : Infinity;
    const size = inside ? (x2 - x1) * (y2 - y1) * view.scale ** 2 : away < NEAR_PX ? 1e4 + away : Infinity;
    if (size < least) [found, least] = [one, size];
  }
  return found;
}
