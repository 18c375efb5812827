// All cameras at a glance: which are live, behind, lost, moved or refused, and how much they see.
import { $, element, on, run, set, state, world } from "./state.js";
import { ON_PICTURE, clock } from "./look.js";
import { loadView } from "./media.js";

const MANY = 5; // cameras with which the page begins here
const EVENTS_MS = 600000;
const THUMB = [320, 180];
const DROPPED = 0.05;
const STATES = {
  live: "live", behind: "behind by", silent: "silent for", lost: "connection lost", moved: "view moved",
  calibrating: "calibrating again", refused: "calibration refused", unplaced: "no place in the site",
  ended: "ended", recorded: "recording",
};
const CALM = ["live", "ended", "recorded"];
const tiles = new Map();

export function startFleet() {
  $("fleet-toggle").addEventListener("click", toggleFleet);
  $("fleet-list").addEventListener("keydown", walk);
  on("fleet-shown", () => {
    document.body.dataset.fleet = String(state.fleet);
    $("fleet").hidden = !state.fleet;
    $("fleet-toggle").setAttribute("aria-pressed", String(state.fleet));
    if (state.fleet) world.runs.forEach(loadView);
  });
  on("fleet fleet-shown run rows searches", showFleet);
  on("time", () => state.fleet && world.data.site && tiles.forEach(paintTile));
  showFleet();
  if (world.data.fleet.length >= MANY) toggleFleet();
}

export function toggleFleet() {
  if (world.data.fleet.length > 1) set("fleet", !state.fleet, "fleet-shown");
}

const runsOf = (camera) => world.runs.filter((one) => one.said.camera === camera);

function showFleet() {
  const { fleet } = world.data;
  $("fleet-toggle").hidden = fleet.length < 2 || !world.runs.length;
  if (!state.fleet) return;
  const counts = Object.entries(STATES).map(([name, text]) => [fleet.filter((one) => one.state === name).length, text.replace(/ (by|for)$/, "")]);
  const nobody = world.runs.length ? "" : "Nobody was tracked yet; this page fills by itself. ";
  $("fleet-said").textContent = `${nobody}${fleet.length} cameras: ${counts.filter(([n]) => n).map((pair) => pair.join(" ")).join(", ")}${world.data.api ? "" : ", when this page was made"}`;
  for (const said of fleet) {
    if (!tiles.has(said.camera)) tiles.set(said.camera, newTile(said));
    showTile(tiles.get(said.camera), said);
  }
}

function newTile({ camera }) {
  const part = (name, kind = "span") => element(kind, { class: name });
  const tile = { camera, canvas: element("canvas", { width: THUMB[0], height: THUMB[1], "aria-hidden": "true" }), state: part("state"), rates: part("soft figure"), seen: part("soft figure"), why: part("why soft small") };
  const inside = [tile.canvas, element("span", { class: "name" }, camera), tile.state, tile.rates, tile.seen, tile.why];
  tile.box = element("button", { class: "tile", "data-camera": camera, onclick: () => choose(camera) }, ...inside);
  $("fleet-list").append(element("li", {}, tile.box));
  return tile;
}

function showTile(tile, said) {
  const runs = runsOf(tile.camera);
  const last = runs[runs.length - 1];
  tile.said = said;
  tile.run = last;
  const now = STATES[said.state] + (said.for_s === undefined ? "" : ` ${said.for_s} s`);
  const dropped = said.dropped >= DROPPED ? `${Math.round(100 * said.dropped)} % of frames dropped` : "";
  const shown = [now, [said.reason, dropped].filter(Boolean).join("; "), ...(last ? figures(runs, last, said.state) : ["nobody seen", ""])];
  tile.box.disabled = !last;
  tile.box.setAttribute("aria-current", String(Boolean(last) && last === run()));
  if (tile.shown !== shown.join("\n")) {
    tile.shown = shown.join("\n");
    tile.state.textContent = now;
    tile.state.dataset.calm = String(CALM.includes(said.state));
    tile.state.dataset.live = String(said.state === "live");
    [tile.why.textContent, tile.rates.textContent, tile.seen.textContent] = shown.slice(1);
  }
  loadNow(tile);
  paintTile(tile);
}

function figures(runs, last, now) {
  const whole = CALM.slice(1).includes(now);
  const from = whole ? -Infinity : last.end - EVENTS_MS;
  const minutes = whole ? runs.reduce((sum, one) => sum + (one.end - one.begin) / 60000, 0) : Math.min(EVENTS_MS, last.end - last.begin) / 60000;
  const rows = whole ? runs.reduce((sum, one) => sum + one.said.rows, 0) / minutes : last.rowsPerMinute;
  const events = (whole ? runs : [last]).reduce((sum, one) => sum + one.happened().filter((event) => event.begin >= from).length, 0) / minutes;
  return [`${Math.round(rows).toLocaleString("en")} rows, ${events.toFixed(events < 10 ? 1 : 0)} events a minute`, `last seen ${day(last)}${clock(1000 * last.said.end_s, last, false)}`];
}

const day = (now) => (now.said.start ? `${new Date(Date.parse(now.said.start) + 1000 * now.said.end_s).toISOString().slice(0, 10)} ` : "");

// The newest picture of a camera that is watched.
function loadNow(tile) {
  const { pictured } = tile.said;
  if (!world.data.api || !tile.run || !pictured || tile.pictured === pictured) return;
  tile.pictured = pictured;
  const image = new Image();
  image.onload = () => {
    tile.now = image;
    paintTile(tile);
  };
  image.src = `${world.data.api}/runs/${tile.run.number}/now?at=${pictured}`;
}

// What it shows, or the empty view with who is there: at this moment in a site, else at its end.
function paintTile(tile) {
  const [wide, high] = THUMB;
  const context = tile.canvas.getContext("2d");
  const now = tile.run;
  const picture = tile.now || (now && now.view);
  context.fillStyle = "#20262d";
  context.fillRect(0, 0, wide, high);
  if (!now) return;
  const [w, h] = now.camera.size;
  const scale = Math.max(wide / w, high / h);
  const [left, top] = [(wide - w * scale) / 2, (high - h * scale) / 2];
  if (picture) context.drawImage(picture, left, top, w * scale, h * scale);
  if (tile.now) return;
  context.lineWidth = 1.5;
  for (const one of now.rows.at(world.data.site ? state.ms : now.rows.end)) {
    const { box: [x1, y1, x2, y2], brief } = now.rows.state(one);
    context.strokeStyle = ON_PICTURE[brief.kind];
    context.strokeRect(left + scale * x1, top + scale * y1, scale * (x2 - x1), scale * (y2 - y1));
  }
}

function choose(camera) {
  const runs = runsOf(camera);
  if (!runs.length) return;
  set("run", world.runs.indexOf(runs[runs.length - 1]));
  toggleFleet();
  $("picture").focus();
}

// Arrow keys go from camera to camera.
function walk(event) {
  const all = [...$("fleet-list").querySelectorAll("button:enabled")];
  const at = all.indexOf(document.activeElement);
  const across = all.filter((one) => one.offsetTop === all[0].offsetTop).length;
  const move = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -across, ArrowDown: across }[event.key];
  if (!move || at < 0) return;
  event.preventDefault();
  event.stopPropagation();
  all[Math.max(0, Math.min(all.length - 1, at + move))].focus();
}
