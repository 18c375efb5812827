// How many are there, whose tracks, what happened, and where nothing was recorded.
import { $, on, passes, run, set, state } from "./state.js";
import { clock, colour, timeStep } from "./look.js";
import { seek } from "./clock.js";

const AXIS_PX = 20;
const EVENTS_PX = 18;
const COUNTS_PX = 34;
const LANE_PX = 10;
const KINDS = ["person", "wheels", "vehicle"];
let canvas = null;
let context = null;
let size = [0, 0, 1];

export function startTimeline() {
  canvas = $("timeline");
  context = canvas.getContext("2d");
  new ResizeObserver(() => {
    const box = canvas.getBoundingClientRect();
    const dpr = Math.min(window.devicePixelRatio || 1, 2);
    size = [box.width, box.height, dpr];
    [canvas.width, canvas.height] = [Math.round(box.width * dpr), Math.round(box.height * dpr)];
    cache.key = null;
    paintTimeline();
  }).observe(canvas);
  on("draw", paintTimeline);
  on("run", () => set("span", null));
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    canvas.setPointerCapture(event.pointerId);
    scrub(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons === 1) scrub(event);
    else hoverLane(event);
  });
  canvas.addEventListener("pointerleave", () => set("hover", null));
  canvas.addEventListener("dblclick", () => set("span", null));
  canvas.addEventListener("wheel", zoomTime, { passive: false });
}

export function spanShown() {
  const now = run();
  return state.span || [now.begin, now.end];
}

const toX = (ms) => {
  const [a, b] = spanShown();
  return ((ms - a) / (b - a)) * size[0];
};

function at(event) {
  const [a, b] = spanShown();
  return a + ((event.clientX - canvas.getBoundingClientRect().left) / size[0]) * (b - a);
}

function scrub(event) {
  const y = event.clientY - canvas.getBoundingClientRect().top;
  if (event.type === "pointerdown" && y < EVENTS_PX) {
    const near = run().events.find((one) => Math.abs(toX(one.begin) - (event.clientX - canvas.getBoundingClientRect().left)) < 6);
    if (near) return seek(near.begin);
  }
  return seek(at(event));
}

function zoomTime(event) {
  if (!event.ctrlKey && !event.shiftKey && matchMedia("(max-width: 1099px)").matches) return;
  event.preventDefault();
  const now = run();
  const [a, b] = spanShown();
  const middle = at(event);
  const factor = Math.exp(event.deltaY / 400);
  const wide = Math.max(1000, (b - a) * factor);
  if (wide >= now.end - now.begin) return set("span", null);
  const left = Math.max(now.begin, Math.min(now.end - wide, middle - ((middle - a) / (b - a)) * wide));
  return set("span", [left, left + wide]);
}

function hoverLane(event) {
  const y = event.clientY - canvas.getBoundingClientRect().top;
  const lane = Math.floor((y - EVENTS_PX - COUNTS_PX) / cache.pitch);
  const ms = at(event);
  const found = (cache.lanes[lane] || []).find((one) => one.begin <= ms && ms <= one.end);
  set("hover", found ? found.track : null);
}

const cache = { key: null, lanes: [], pitch: LANE_PX, canvas: document.createElement("canvas") };

// Each track in the first lane that is free.
function lanesOf(brief, most) {
  const free = [];
  const lanes = [];
  for (const one of [...brief].sort((a, b) => a.begin - b.begin)) {
    let lane = free.findIndex((end) => end < one.begin);
    if (lane < 0) lane = free.length < most ? free.length : free.indexOf(Math.min(...free));
    free[lane] = one.end;
    (lanes[lane] ??= []).push(one);
  }
  return lanes;
}

function paintBelow() {
  const now = run();
  const [a, b] = spanShown();
  const key = [state.run, now.version, now.events.length, a, b, ...size, JSON.stringify(state.filter), document.documentElement.dataset.theme].join(" ");
  if (cache.key === key) return;
  cache.key = key;
  [cache.canvas.width, cache.canvas.height] = [canvas.width, canvas.height];
  const made = cache.canvas.getContext("2d");
  made.setTransform(size[2], 0, 0, size[2], 0, 0);
  paintCounts(made, now, a, b);
  paintLanes(made, now);
  paintLost(made, now);
  paintEvents(made, now);
  paintAxis(made, now, a, b);
}

function paintCounts(made, now, a, b) {
  const bins = Math.max(20, Math.floor(size[0] / 2));
  const counts = now.rows.counts(a, b, bins);
  let most = 1;
  for (let i = 0; i < bins; i++) most = Math.max(most, KINDS.reduce((sum, kind) => sum + counts[kind][i], 0));
  const base = EVENTS_PX + COUNTS_PX - 4;
  const high = (COUNTS_PX - 8) / most;
  for (let i = 0; i < bins; i++) {
    let y = base;
    for (const kind of KINDS) {
      const tall = counts[kind][i] * high;
      made.fillStyle = colour(kind);
      made.fillRect(Math.floor((i * size[0]) / bins), y - tall, Math.ceil(size[0] / bins), tall);
      y -= tall;
    }
  }
  made.fillStyle = colour("soft");
  made.font = "11px system-ui, sans-serif";
  made.textAlign = "right";
  made.fillText(`most at once: ${most}`, size[0] - 4, EVENTS_PX + 4);
  made.textAlign = "left";
}

function paintLanes(made, now) {
  const room = size[1] - AXIS_PX - EVENTS_PX - COUNTS_PX;
  const most = Math.max(1, Math.floor(room / 3));
  cache.lanes = lanesOf(now.rows.brief.filter(passes), most);
  cache.pitch = Math.min(LANE_PX, room / Math.max(1, cache.lanes.length));
  const [a, b] = spanShown();
  cache.lanes.forEach((lane, number) => {
    const y = EVENTS_PX + COUNTS_PX + number * cache.pitch;
    for (const one of lane) {
      if (one.end < a || one.begin > b) continue;
      made.fillStyle = colour(one.kind);
      made.globalAlpha = 0.85;
      made.fillRect(toX(one.begin), y, Math.max(1.5, toX(one.end) - toX(one.begin)), Math.max(1.5, cache.pitch - 2));
    }
  });
  made.globalAlpha = 1;
}

function paintLost(made, now) {
  for (const [begin, end] of now.said.lost) {
    const [x, wide] = [toX(1000 * begin), toX(1000 * end) - toX(1000 * begin)];
    made.fillStyle = colour("line");
    made.fillRect(x, EVENTS_PX, wide, size[1] - AXIS_PX - EVENTS_PX);
    made.fillStyle = colour("soft");
    if (wide > 70) made.fillText("not recorded", x + 5, EVENTS_PX + 14);
  }
}

function paintEvents(made, now) {
  for (const one of now.events) {
    const [x, wide] = [toX(one.begin), Math.max(3, toX(one.end) - toX(one.begin))];
    made.fillStyle = colour("accent");
    made.globalAlpha = 0.16;
    made.fillRect(x, 3, wide, EVENTS_PX - 6);
    made.globalAlpha = 1;
    made.fillRect(x, 3, 2, EVENTS_PX - 6);
  }
}

function paintAxis(made, now, a, b) {
  const step = timeStep(((b - a) * 84) / Math.max(size[0], 1));
  made.fillStyle = colour("soft");
  made.strokeStyle = colour("line");
  made.font = "11px system-ui, sans-serif";
  for (let ms = Math.ceil(a / step) * step; ms <= b; ms += step) {
    const x = Math.round(toX(ms)) + 0.5;
    made.beginPath();
    made.moveTo(x, size[1] - AXIS_PX);
    made.lineTo(x, size[1] - AXIS_PX + 5);
    made.stroke();
    const text = clock(ms, now, step < 1000);
    if (x + 6 * text.length < size[0]) made.fillText(text, x + 3, size[1] - 5);
  }
}

function paintTimeline() {
  if (!run() || !size[0]) return;
  paintBelow();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, canvas.width, canvas.height);
  context.drawImage(cache.canvas, 0, 0);
  context.setTransform(size[2], 0, 0, size[2], 0, 0);
  outlined(state.hover);
  for (const track of [state.selected, ...state.cast]) outlined(track);
  const x = toX(state.ms);
  context.strokeStyle = context.fillStyle = colour("ink");
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x, 4);
  context.lineTo(x, size[1] - AXIS_PX);
  context.stroke();
  context.beginPath();
  context.arc(x, 5, 4, 0, 7);
  context.fill();
}

function outlined(track) {
  if (track === null) return;
  cache.lanes.forEach((lane, number) => {
    const one = lane.find((each) => each.track === track);
    if (!one) return;
    context.strokeStyle = colour("ink");
    context.lineWidth = 1.5;
    const y = EVENTS_PX + COUNTS_PX + number * cache.pitch;
    context.strokeRect(toX(one.begin) - 1, y - 1, toX(one.end) - toX(one.begin) + 2, Math.max(3, cache.pitch));
  });
}
