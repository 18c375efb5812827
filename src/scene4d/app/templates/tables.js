// The table of tracks: filtered, sorted, and a way to each of them.
import { $, element, on, passes, run, set, state, tell, world } from "./state.js";
import { plusMinus } from "./look.js";
import { seek } from "./clock.js";
import { placesHere } from "./places.js";

const MOST_ROWS = 200;
const COLUMNS = [
  ["track", "Track", (one) => `${one.class} ${one.track}`],
  ["lasting", "Time, s", (one) => ((one.end - one.begin) / 1000).toFixed(1)],
  ["path", "Path, m", (one) => one.path.toFixed(1)],
  ["speed", "m/s", (one) => (Number.isFinite(one.speed) ? one.speed.toFixed(1) : "unknown")],
  ["size", "Size, m", (one) => sizeOf(one)],
  ["colour", "Colour", (one) => one.colours.filter(Boolean).map(([name]) => name).join(", ")],
];
let sorted = { by: "track", down: false };

// The height of people, the length of vehicles.
function sizeOf(one) {
  if (one.kind !== "person" && Number.isFinite(one.length_m)) return plusMinus(one.length_m, one.length_sigma_m, "long");
  return Number.isFinite(one.height_m) ? plusMinus(one.height_m, one.height_sigma_m, "tall") : "unknown";
}

export function startTables() {
  const head = $("tracks-head");
  for (const [key, title] of COLUMNS) {
    head.append(element("th", { scope: "col", "aria-sort": "none", "data-key": key },
      element("button", { class: "sort", onclick: () => sortBy(key) }, title)));
  }
  $("filter-kind").addEventListener("change", () => filter("kind", $("filter-kind").value));
  $("filter-words").addEventListener("input", () => filter("words", $("filter-words").value.trim()));
  $("filter-fastest").addEventListener("input", () => filter("fastest", Number($("filter-fastest").value)));
  $("filter-path").addEventListener("input", () => filter("path", Number($("filter-path").value)));
  $("filter-zone").addEventListener("change", () => filter("zone", $("filter-zone").value));
  $("filter-lasting").addEventListener("input", () => filter("lasting", Number($("filter-lasting").value)));
  on("places places-changed run", showZones);
  on("run rows filter", showTracks);
  on("selected", markSelected);
}

function showZones() {
  const zones = placesHere().filter((place) => place.kind === "zone").map((place) => place.name);
  $("filter-zone").replaceChildren(
    element("option", { value: "" }, "anywhere"), ...zones.map((name) => element("option", { value: name }, name)),
  );
  if (!zones.includes(state.filter.zone)) filter("zone", "");
  else $("filter-zone").value = state.filter.zone;
}

function filter(name, value) {
  state.filter = { ...state.filter, [name]: value };
  $("filter-fastest-said").textContent = `${state.filter.fastest.toFixed(1)} m/s`;
  $("filter-path-said").textContent = `${state.filter.path.toFixed(0)} m`;
  tell("filter");
}

function sortBy(key) {
  sorted = { by: key, down: sorted.by === key && !sorted.down };
  showTracks();
}

function order(one) {
  if (sorted.by === "lasting") return one.end - one.begin;
  if (sorted.by === "colour") return one.colours.flat().join();
  if (sorted.by === "size") return (one.kind === "person" ? one.height_m : one.length_m) || 0;
  return one[sorted.by] || 0;
}

function showTracks() {
  const now = run();
  if (!now) return;
  const kept = now.rows.brief.filter(passes).sort((a, b) => (order(a) < order(b) ? -1 : Number(order(a) > order(b))) * (sorted.down ? -1 : 1));
  for (const head of document.querySelectorAll("#tracks-head th")) {
    head.setAttribute("aria-sort", head.dataset.key === sorted.by ? (sorted.down ? "descending" : "ascending") : "none");
  }
  const all = now.rows.brief.length;
  const fewer = kept.length > MOST_ROWS ? `, the first ${MOST_ROWS} are shown` : "";
  const coming = !all && now.said.rows && world.data.api && !now.rows.count;
  $("tracks-count").textContent = coming ? `reading ${now.said.rows.toLocaleString("en")} rows` : `${kept.length} of ${all} track${all === 1 ? "" : "s"}${fewer}`;
  $("tracks").classList.toggle("uncoloured", !now.rows.brief.some((one) => one.colours.some(Boolean)));
  $("tracks-body").replaceChildren(...kept.slice(0, MOST_ROWS).map(trackRow));
  markSelected();
}

function trackRow(one) {
  const cells = COLUMNS.map(([key, , text]) => {
    if (key !== "track") return element("td", { class: "number" }, text(one));
    const go = element("button", { class: "link" }, element("span", { class: `dot ${one.kind}`, "aria-hidden": "true" }), text(one));
    return element("th", { scope: "row" }, go);
  });
  return element("tr", {
    "data-track": one.track,
    onclick: () => choose(one),
    onpointerenter: () => set("hover", one.track),
    onpointerleave: () => set("hover", null),
  }, ...cells);
}

function choose(one) {
  state.cast = [];
  if (state.selected === one.track) return set("selected", null);
  set("selected", one.track);
  if (state.ms < one.begin || state.ms > one.end) seek(one.begin);
}

function markSelected() {
  for (const row of document.querySelectorAll("#tracks-body tr")) {
    const chosen = Number(row.dataset.track) === state.selected;
    row.classList.toggle("chosen", chosen);
    row.querySelector("button").setAttribute("aria-pressed", String(chosen));
    if (chosen && state.tab === "tracks") row.scrollIntoView({ block: "nearest" });
  }
}
