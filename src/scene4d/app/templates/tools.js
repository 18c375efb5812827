// The mouse in the picture and on the plan: who is there, the ruler, and what is being drawn.
import { $, announce, draw, element, on, run, set, state, tell, world } from "./state.js";
import { distanceBetween, distanceFrom, heightBetween } from "./camera.js";
import { lonLat, placeSigma } from "./geo.js";
import { halo, label, metres, plusMinus } from "./look.js";
import { pictureView, trackInPicture } from "./picture.js";
import { onPlan, planPoint, planView, trackOnPlan } from "./plan.js";
import { addPoint, finishPlace, placesHere } from "./places.js";
import { dragHorizon, grabHorizon, judgeInPicture, triedCamera } from "./judge.js";

export const TOOLS = [
  ["look", "Look", "v"], ["measure", "Measure", "m"], ["zone", "Zone", "z"], ["line", "Line", "l"], ["judge", "Judge", "j"],
];
const DARK = "#ffd84d";

export function startTools() {
  for (const [pane, view, point] of [["picture", pictureView(), inPicture], ["plan", planView(), inPlan]]) {
    const canvas = $(pane);
    canvas.addEventListener("pointermove", (event) => moved(pane, point(view.at(event)), event, view.at(event)));
    canvas.addEventListener("pointerleave", () => {
      set("pointer", null);
      set("hover", null);
      $("tip").hidden = true;
    });
    canvas.addEventListener("pointerdown", (event) => {
      const [px, py] = view.at(event);
      const judging = pane === "picture" && state.tool === "judge";
      view.held = judging && grabHorizon(px, py, view);
      const place = judging && !view.held ? point([px, py]) : null;
      world.foot = place && place.xy ? place : null;
    });
    canvas.addEventListener("click", (event) => {
      const { foot } = world;
      world.foot = null;
      if (view.held) view.held = false;
      else if (foot && isFar(view, foot.uv, view.at(event))) raise(foot, point(view.at(event)).uv);
      else if (!view.dragged) clicked(pane, point(view.at(event)), view.at(event));
    });
    canvas.addEventListener("dblclick", () => finishPlace());
    canvas.addEventListener("keydown", (event) => cursor(event, pane, view, point));
  }
  on("tool", () => {
    world.draft = null;
    document.body.dataset.tool = state.tool;
    for (const button of document.querySelectorAll("#tools button")) {
      button.setAttribute("aria-pressed", String(button.dataset.tool === state.tool));
    }
    $("hint").textContent = HINTS[state.tool];
  });
}

const HINTS = {
  look: "",
  measure: "Click one point for its distance from the camera, a second for the length between them.",
  zone: "Click the corners in the picture or on the plan; Enter or a double click ends the zone.",
  line: "Click the points of the line; Enter or a double click ends it.",
  judge: "An upright stands where you point. Drag the ends of the horizon to try another camera, or from the foot of something upright to its top to measure it.",
};

function inPicture([px, py]) {
  const uv = pictureView().from(px, py);
  const xy = run().camera.locate(...uv);
  return { uv, xy };
}

function inPlan([px, py]) {
  const xy = planPoint(px, py);
  const uv = run().camera.project(...xy, 0);
  return { uv, xy };
}

function moved(pane, place, event, [px, py]) {
  const now = run();
  if (!now) return;
  const view = pane === "picture" ? pictureView() : planView();
  if (view.held && event.buttons === 1) dragHorizon(place.uv);
  state.pointer = { ...place, pane };
  view.cursor = null;
  draw();
  const found = state.tool === "look" ? (pane === "picture" ? trackInPicture : trackOnPlan)(now, px, py) : null;
  set("hover", found ? found.brief.track : null);
  $(pane).style.cursor = state.tool === "look" ? (found ? "pointer" : "default") : "crosshair";
  showTip(found, event, place);
}

function showTip(found, event, place) {
  const tip = $("tip");
  const text = found ? aboutTrack(found) : state.tool === "look" ? null : aboutPlace(place);
  tip.hidden = !text;
  if (!text) return;
  tip.replaceChildren(...text);
  const [wide, high] = [tip.offsetWidth, tip.offsetHeight];
  tip.style.left = `${Math.max(4, Math.min(event.clientX + 16, innerWidth - wide - 8))}px`;
  tip.style.top = `${event.clientY + 18 + high > innerHeight ? event.clientY - high - 10 : event.clientY + 18}px`;
}

function aboutPlace({ xy }) {
  if (!xy) return [element("span", {}, "above the ground in view")];
  return [element("span", {}, `x ${xy[0].toFixed(2)} m, y ${xy[1].toFixed(2)} m`)];
}

// Who is where, with what certainty.
export function aboutTrack(one) {
  const camera = run().camera;
  const { brief } = one;
  const row = (name, value) => element("div", {}, element("dt", {}, name), element("dd", {}, value));
  const [own, whole] = [one.own, one.whole].map(([x, y]) => Math.hypot(x, y));
  const away = Math.hypot(one.xy[0] - camera.centre[0], one.xy[1] - camera.centre[1]);
  const list = element("dl", {},
    row("Place", Number.isFinite(one.xy[0]) ? `${one.xy[0].toFixed(1)}, ${one.xy[1].toFixed(1)} m` : "unknown"),
    row("± in the scene", metres(own)),
    row("± with the camera's error", metres(whole)),
    world.fused ? row("Seen by", seenBy(brief.track).join(", ") || "nobody now") : row("From the camera", metres(away, 1)),
    ...earthOf(one.xy).map((text) => row("Latitude, longitude", text)),
    row("Speed", `${Math.hypot(...one.velocity).toFixed(1)} m/s`),
  );
  if (Number.isFinite(brief.height_m)) list.append(row("Height", plusMinus(brief.height_m, brief.height_sigma_m)));
  if (Number.isFinite(brief.length_m)) list.append(row("Length", plusMinus(brief.length_m, brief.length_sigma_m)));
  brief.colours.forEach((colour, part) => {
    const what = brief.kind === "vehicle" ? "Colour" : ["Upper body", "Lower body"][part];
    if (colour) list.append(row(what, `${colour[0]}, p ${colour[1].toFixed(2)}`));
  });
  if (Number.isFinite(brief.existence_probability)) list.append(row("Is real", `p ${brief.existence_probability.toFixed(2)}`));
  list.append(row("Now", one.observed ? "seen" : "not seen, bridged"));
  return [element("strong", {}, `${brief.class} ${brief.track}`), list];
}

const earthOf = (xy) => {
  if (!world.data.anchor || !Number.isFinite(xy[0])) return [];
  const [lon, lat] = lonLat(world.data.anchor, xy);
  return [`${lat.toFixed(6)}°, ${lon.toFixed(6)}°`];
};

// The cameras of a site that see somebody now.
const seenBy = (track) => world.runs.filter((one) => one.there().some((other) => other.brief.track === track && other.observed)).map((one) => one.said.camera);

export function clicked(pane, place, [px, py]) {
  const now = run();
  if (state.tool === "look") {
    const found = (pane === "picture" ? trackInPicture : trackOnPlan)(now, px, py);
    state.cast = [];
    draw();
    set("selected", found && state.selected !== found.brief.track ? found.brief.track : null);
  } else if (!place.xy) announce("There is no ground at this point: it lies at or above the horizon.");
  else if (state.tool === "measure") measure(place);
  else if (state.tool === "zone" || state.tool === "line") addPoint(place.xy);
}

// Distances: one point from the camera, two from each other.
function measure(place) {
  const last = world.marks[world.marks.length - 1];
  if (last && last.run === state.run && last.points.length === 1) last.points.push(place);
  else world.marks.push({ run: state.run, points: [place], known: "" });
  judged(world.marks[world.marks.length - 1]);
  tell("marks");
}

const isFar = (view, uv, [px, py]) => {
  const [x, y] = view.to(...uv);
  return Math.hypot(x - px, y - py) > 10;
};

// Something upright, dragged from its foot to its top.
function raise(foot, top) {
  const mark = { run: state.run, points: [foot, { uv: top, xy: foot.xy }], known: "", upright: true };
  world.marks.push(mark);
  judged(mark);
  tell("marks");
  set("tab", "measure");
}

export function judged(mark) {
  const camera = world.runs[mark.run].camera;
  const pixels = mark.points.map((point) => point.uv);
  const seen = pixels.every(Boolean);
  const of = mark.upright ? heightBetween : pixels.length === 1 ? distanceFrom : distanceBetween;
  const [a, b] = mark.points.map((point) => point.xy);
  const end = b || [camera.centre[0], camera.centre[1]];
  mark.value = mark.upright ? heightBetween(camera, pixels) : Math.hypot(a[0] - end[0], a[1] - end[1]);
  const scale = pictureView().scale || 1;
  mark.sigma = seen ? camera.sigma(of, pixels, Math.max(0.5, 1 / scale)) : { camera: null, clicks: null, total: null };
  mark.text = plusMinus(mark.value, mark.sigma.total);
  for (const point of mark.points) point.earth = onEarth(camera, point, Math.max(0.5, 1 / scale));
  announce(`${mark.upright ? "Height" : mark.points.length === 1 ? "From the camera" : "Length"}: ${mark.text}`);
}

// Where on the Earth a point is, in words and for other programs; null where that is not known.
function onEarth(camera, point, clickPx) {
  const { anchor } = world.data;
  if (!anchor || !point.xy) return null;
  const [lon, lat] = lonLat(anchor, point.xy);
  const sigma = placeSigma(camera, point, clickPx);
  const spread = (k) => (sigma ? ` ± ${sigma[k].toFixed(sigma[k] < 1 ? 2 : 1)} m` : "");
  return {
    text: [`Latitude ${lat.toFixed(7)}°${spread(1)}`, `Longitude ${lon.toFixed(7)}°${spread(0)}`],
    copied: `${lat.toFixed(7)}, ${lon.toFixed(7)}`,
  };
}

export function marksInPicture(context, view, now) {
  const shown = (xy) => {
    const uv = now.camera.project(...xy, 0);
    return uv && view.to(...uv);
  };
  paintPlaces(context, shown, 24);
  for (const mark of world.marks.filter((one) => one.run === state.run)) {
    paintMark(context, mark, mark.points.map((point) => (point.uv ? view.to(...point.uv) : shown(point.xy))));
  }
  if (state.tool === "judge") judgeInPicture(context, view, now);
  else if (state.pointer && state.pointer.xy && state.tool !== "look") paintCross(context, state.pointer.uv && view.to(...state.pointer.uv));
  if (state.pointer && state.pointer.pane === "plan" && state.pointer.xy && state.tool === "look") {
    paintCross(context, shown(state.pointer.xy));
  }
}

export function marksOnPlan(context, to, now) {
  paintPlaces(context, (xy) => to(...xy), 1);
  for (const mark of world.marks.filter((one) => one.run === state.run)) {
    paintMark(context, mark, mark.points.map((point) => to(...point.xy)), to(now.camera.centre[0], now.camera.centre[1]));
  }
  if (state.pointer && state.pointer.xy && state.pointer.pane === "picture") paintCross(context, to(...state.pointer.xy));
}

function paintCross(context, at) {
  if (!at) return;
  context.strokeStyle = DARK;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(at[0] - 7, at[1]);
  context.lineTo(at[0] + 7, at[1]);
  context.moveTo(at[0], at[1] - 7);
  context.lineTo(at[0], at[1] + 7);
  halo(context, () => context.stroke());
}

function paintMark(context, mark, ends, origin = null) {
  const there = ends.filter(Boolean);
  if (!there.length) return;
  const line = there.length === 1 && origin ? [origin, ...there] : there;
  context.strokeStyle = context.fillStyle = DARK;
  context.lineWidth = 2;
  context.setLineDash(there.length === 1 ? [5, 4] : []);
  context.beginPath();
  line.forEach((point, i) => context[i ? "lineTo" : "moveTo"](...point));
  halo(context, () => context.stroke());
  context.setLineDash([]);
  for (const [x, y] of there) {
    context.beginPath();
    context.arc(x, y, 4, 0, 7);
    halo(context, () => context.stroke(), 1.5);
    context.fill();
  }
  const [a, b] = [there[0], there[there.length - 1]];
  label(context, mark.text, (a[0] + b[0]) / 2 + 8, (a[1] + b[1]) / 2 - 8, { fill: DARK });
}

function paintPlaces(context, to, pieces) {
  const drawn = placesHere().map((place) => ({ ...place, closed: place.kind === "zone" }));
  const draft = world.draft;
  if (draft) {
    const more = state.pointer && state.pointer.xy ? [state.pointer.xy] : [];
    drawn.push({ name: "", points: [...draft.points, ...more], closed: draft.kind === "zone" && draft.points.length > 1 });
  }
  for (const place of drawn) paintOutline(context, place, to, pieces);
}

function paintOutline(context, place, to, pieces) {
  const points = place.closed ? [...place.points, place.points[0]] : place.points;
  context.strokeStyle = DARK;
  context.fillStyle = "rgba(255, 216, 77, 0.16)";
  context.lineWidth = 2;
  context.setLineDash([6, 4]);
  context.beginPath();
  let first = null;
  for (let i = 0; i + 1 < points.length; i++) {
    for (let k = 0; k <= pieces; k++) {
      const share = k / pieces;
      const at = to(points[i].map((value, axis) => value + share * (points[i + 1][axis] - value)));
      if (!at) continue;
      context[first ? "lineTo" : "moveTo"](...at);
      first ??= at;
    }
  }
  if (place.closed) context.fill();
  halo(context, () => context.stroke());
  context.setLineDash([]);
  for (const point of place.name ? [] : place.points) {
    const at = to(point);
    if (at) context.fillRect(at[0] - 3, at[1] - 3, 6, 6);
  }
  if (place.name && first) label(context, place.name, first[0] + 4, first[1] - 4, { fill: DARK });
}

// A cross moved with the arrow keys, for those who do not point with a mouse; Enter clicks, and a
// second Enter at the same point ends what is being drawn.
function cursor(event, pane, view, point) {
  const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const step = steps[event.key];
  if (state.tool === "look" || !(step || (event.key === "Enter" && view.cursor))) return;
  event.preventDefault();
  event.stopPropagation();
  if (step) {
    const far = event.shiftKey ? 20 : 4;
    view.cursor = (view.cursor || [view.width / 2, view.height / 2]).map((value, i) => value + far * step[i]);
    view.entered = false;
    state.pointer = { ...point(view.cursor), pane };
    draw();
  } else if (view.entered && world.draft) finishPlace();
  else {
    view.entered = true;
    clicked(pane, point(view.cursor), view.cursor);
  }
}
