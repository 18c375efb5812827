// The ground from straight above, in metres.
import { $, isLit, on, run, state, world } from "./state.js";
import { Viewport } from "./viewport.js";
import { Cached, strokeTracks } from "./cached.js";
import { colour, label, niceStep } from "./look.js";
import { groundPhoto, layer } from "./scenery.js";
import { flowLegend, paintFlow } from "./flow.js";
import { cornersOf, ellipse } from "./picture.js";
import { marksOnPlan } from "./tools.js";

const NEAR_PX = 18;
const TRAIL_MS = 4000;
let view = null;
let paths = null;
let photos = null;
let heat = null;
let flow = null;

export function startPlan() {
  view = new Viewport($("plan"), () => {
    const areas = run() ? together(run()).map((one) => one.area) : [[-10, 0, 10, 20]];
    const edge = (i, of) => of(...areas.map((area) => area[i]));
    return [edge(0, Math.min), -edge(3, Math.max), edge(2, Math.max), -edge(1, Math.min)];
  });
  paths = new Cached(view);
  photos = new Cached(view);
  heat = new Cached(view);
  flow = new Cached(view);
  on("run", () => (world.data.site ? view.changed() : view.reset()));
  on("draw", paintPlan);
  return view;
}

export const planView = () => view;

export const onPlan = (x, y) => view.to(x, -y);

export function planPoint(px, py) {
  const [x, y] = view.from(px, py);
  return [x, -y];
}

function paintPlan() {
  const now = run();
  if (!now || !view.width) return;
  const context = view.begin();
  const owner = world.data.site ? world : now; // all cameras of a site share the plan
  const ready = together(now).map((one) => `${one.viewReady} ${one.areaVersion}`).join();
  if (layer("photo")) photos.show(owner, ready, (made) => paintPhotos(made, now));
  paintGrid(context);
  for (const one of together(now)) paintCamera(context, one, one === now);
  const counted = layer("apart") ? now : moving(now)[0]; // heat and flow are of one camera where each has its own
  const what = `${state.run} ${layer("apart")} ${moving(now).map((one) => one.version)} ${JSON.stringify(state.filter)}`;
  if (layer("heat")) heat.show(owner, what, (made) => paintHeat(made, counted));
  if (layer("paths")) paths.show(owner, `${what} ${colour("person")}`, (made) => paintPaths(made, moving(now)));
  if (layer("flow")) flow.show(owner, what, (made) => paintStreams(made, counted));
  paintLegends(context, counted);
  for (const other of moving(now)) {
    const there = other.there();
    if (layer("paths")) there.forEach((one) => paintTrail(context, other, one));
    paintSelected(context, other);
    there.forEach((one) => paintOne(context, one));
  }
  marksOnPlan(context, onPlan, now);
  paintScale(context);
}

function lineTo(context, points) {
  context.beginPath();
  points.forEach((point, i) => context[i ? "lineTo" : "moveTo"](...onPlan(...point)));
}

function* paintPhotos(context, now) {
  context.globalAlpha = 0.55;
  for (const one of together(now)) {
    if (!one.view) continue;
    one.photo ??= groundPhoto(one.camera, one.view, one.area);
    const [x0, y0, x1, y1] = one.area;
    context.drawImage(one.photo, ...onPlan(x0, y1), (x1 - x0) * view.scale, (y1 - y0) * view.scale);
    yield;
  }
}

// The runs on this ground: all of a site.
const together = (now) => (world.data.site ? world.runs : [now]);

// What moves on it: in a site everybody once, or as each camera sees them.
const moving = (now) => (world.fused && !layer("apart") ? [world.fused] : together(now));

function paintGrid(context) {
  const [ax, ay] = planPoint(0, view.height);
  const [bx, by] = planPoint(view.width, 0);
  const step = niceStep(70 / view.scale);
  context.lineWidth = 1;
  context.font = "11px system-ui, sans-serif";
  const digits = step < 1 ? 1 : 0;
  for (let x = Math.ceil(ax / step) * step; x <= bx; x += step) {
    const [px] = onPlan(x, 0);
    gridLine(context, px, 0, px, view.height);
    context.fillText(`${(x + 0).toFixed(digits)}`, px + 3, view.height - 4);
  }
  for (let y = Math.ceil(ay / step) * step; y <= by; y += step) {
    const [, py] = onPlan(0, y);
    gridLine(context, 0, py, view.width, py);
    context.fillText(`${(y + 0).toFixed(digits)}`, 3, py - 3);
  }
}

function gridLine(context, ...ends) {
  context.strokeStyle = colour("grid");
  context.fillStyle = colour("soft");
  context.beginPath();
  context.moveTo(Math.round(ends[0]) + 0.5, Math.round(ends[1]) + 0.5);
  context.lineTo(Math.round(ends[2]) + 0.5, Math.round(ends[3]) + 0.5);
  context.stroke();
}

function paintCamera(context, { camera, area, said }, current) {
  const reach = Math.max(area[2] - area[0], area[3] - area[1]);
  const [width, height] = camera.size;
  const [cx, cy] = camera.centre;
  const edge = [];
  const far = 3 * reach;
  const add = (u, v) => {
    const place = camera.locate(u, v, 0);
    const away = place ? Math.hypot(place[0] - cx, place[1] - cy) : Infinity;
    if (place && away <= far) edge.push(place);
    else if (place) edge.push([cx + ((place[0] - cx) * far) / away, cy + ((place[1] - cy) * far) / away]);
  };
  for (let i = 0; i <= 40; i++) add(0, (height * i) / 40);
  for (let i = 0; i <= 40; i++) add((width * i) / 40, height - 1);
  for (let i = 40; i >= 0; i--) add(width - 1, (height * i) / 40);
  context.strokeStyle = colour("accent");
  context.lineWidth = 1;
  context.globalAlpha = 0.5;
  context.setLineDash([2, 4]);
  if (edge.length > 1) {
    lineTo(context, edge);
    context.stroke();
  }
  context.setLineDash([]);
  context.globalAlpha = 1;
  const ahead = Math.atan2(camera.R[2][1], camera.R[2][0]);
  const [px, py] = onPlan(cx, cy);
  context.save();
  context.translate(px, py);
  context.rotate(-ahead);
  context.fillStyle = colour(current ? "accent" : "soft");
  context.strokeStyle = colour("card");
  context.lineWidth = 1.5;
  context.beginPath();
  context.roundRect(-9, -5, 11, 10, 2);
  context.moveTo(2, -2);
  context.lineTo(9, -6);
  context.lineTo(9, 6);
  context.lineTo(2, 2);
  context.stroke();
  context.fill();
  context.restore();
  if (world.data.site) label(context, said.camera, px + 12, py + 6);
}

function* paintHeat(context, now) {
  const found = now.heat();
  const [x0, y0, x1, y1] = now.area;
  const [a, b] = onPlan(x0, y1);
  context.imageSmoothingQuality = "high";
  context.drawImage(found.canvas, a, b, (x1 - x0) * view.scale, (y1 - y0) * view.scale);
}

function paintLegends(context, counted) {
  const base = view.height - 24;
  if (layer("heat")) {
    const { most } = counted.heat();
    label(context, `darkest: ${most < 10 ? most.toFixed(1) : Math.round(most)} s per m²`, 30, base);
  }
  if (layer("flow")) flowLegend(context, counted.flow(), 30, layer("heat") ? base - 22 : base);
}

function* paintStreams(context, now) {
  paintFlow(context, now.flow(), onPlan);
}

function* paintPaths(context, all) {
  context.lineWidth = 1.1;
  context.globalAlpha = 0.38;
  const tints = Object.fromEntries(["person", "wheels", "vehicle"].map((kind) => [kind, colour(kind)]));
  for (const { rows } of all) {
    yield* strokeTracks(context, rows, tints, (k) => traceRows(context, rows, rows.starts[k], rows.starts[k + 1]));
  }
}

const traceRows = (context, rows, first, last) => view.trace(context, rows.columns.x_m, rows.columns.y_m, first, last, -1);

function strokeRows(context, rows, first, last) {
  context.beginPath();
  traceRows(context, rows, first, last);
  context.stroke();
}

function paintTrail(context, now, one) {
  let first = one.row;
  while (first > now.rows.starts[one.k] && now.rows.time[first] > state.ms - TRAIL_MS) first--;
  context.strokeStyle = colour(one.brief.kind);
  context.lineWidth = 2.2;
  strokeRows(context, now.rows, first, one.row + 1);
}

function paintSelected(context, now) {
  for (const track of [state.selected, ...state.cast]) {
    const k = now.rows.byNumber.get(track);
    if (k === undefined) continue;
    context.strokeStyle = colour(now.rows.brief[k].kind);
    context.lineWidth = 3;
    strokeRows(context, now.rows, now.rows.starts[k], now.rows.starts[k + 1]);
  }
}

function paintOne(context, one) {
  if (!Number.isFinite(one.xy[0])) return;
  const lit = isLit(one.brief.track);
  context.strokeStyle = context.fillStyle = colour(one.brief.kind);
  if (layer("sigma")) paintSigma(context, one);
  const corners = cornersOf(one);
  const [x, y] = onPlan(...one.xy);
  if (corners) {
    lineTo(context, [...corners, corners[0]].map(([a, b]) => [a, b]));
    context.globalAlpha = 0.3;
    context.fill();
    context.globalAlpha = 1;
    context.lineWidth = lit ? 3 : 1.6;
    context.stroke();
  }
  const speed = Math.hypot(...one.velocity);
  if (speed > 0.2) {
    const [tx, ty] = onPlan(one.xy[0] + one.velocity[0], one.xy[1] + one.velocity[1]);
    context.lineWidth = 1.6;
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(tx, ty);
    context.stroke();
  }
  context.beginPath();
  context.arc(x, y, lit ? 7 : 5, 0, 7);
  if (one.observed) context.fill();
  context.lineWidth = 1.5;
  context.strokeStyle = one.observed ? colour("card") : colour(one.brief.kind);
  context.stroke();
  if (lit) label(context, `${one.brief.class} ${one.brief.track}`, x + 9, y - 6);
}

function paintSigma(context, one) {
  for (const [kind, dashes] of [["whole", [3, 4]], ["own", []]]) {
    const ring = ellipse(one, one[kind], 24);
    if (!ring) continue;
    context.lineWidth = 1.2;
    context.setLineDash(dashes);
    lineTo(context, ring);
    context.globalAlpha = 0.25;
    if (kind === "own") context.fill();
    context.globalAlpha = 1;
    context.stroke();
  }
  context.setLineDash([]);
}

function paintScale(context) {
  const step = niceStep(60 / view.scale);
  const wide = step * view.scale;
  const [x, y] = [view.width - wide - 14, view.height - 16];
  context.strokeStyle = colour("ink");
  context.fillStyle = colour("ink");
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(x + wide, y);
  context.stroke();
  context.font = "600 11.5px system-ui, sans-serif";
  context.textAlign = "center";
  context.fillText(`${step} m`, x + wide / 2, y - 5);
  context.textAlign = "left";
}

export function trackOnPlan(now, px, py) {
  let [found, least] = [null, NEAR_PX];
  for (const one of moving(now).flatMap((other) => other.there())) {
    const [x, y] = onPlan(...one.xy);
    const away = Math.hypot(x - px, y - py);
    if (away < least) [found, least] = [one, away];
  }
  return found;
}
