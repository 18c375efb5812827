// The panel: tabs, layers, what was measured, the places, and the camera.
import { $, LAYERS, announce, download, element, on, run, set, state, tell, world } from "./state.js";
import { TOOLS, judged } from "./tools.js";
import { placeRow, placesJson } from "./places.js";
import { calibrateCommand, forget, knownMarks, landmarksJson, orientationJson, tryCamera } from "./judge.js";
import { plusMinus } from "./look.js";

export const TABS = ["events", "tracks", "measure", "places", "camera"];

export function startPanel() {
  startTabs();
  startLayers();
  for (const [name, title, key] of TOOLS) {
    $("tools").append(element("button", {
      "data-tool": name, "aria-pressed": String(name === "look"), title: `${title} (${key.toUpperCase()})`,
      onclick: () => set("tool", name),
    }, icon(name), element("span", {}, title)));
  }
  on("marks run", showMarks);
  on("places places-changed run", showPlaces);
  on("tried run", showCamera);
  on("tool", () => {
    if (state.tool === "measure") set("tab", "measure");
    if (state.tool === "judge") set("tab", "camera");
    if (state.tool === "zone" || state.tool === "line") set("tab", "places");
  });
  $("marks-clear").addEventListener("click", () => {
    world.marks = [];
    tell("marks");
  });
  $("places-save").addEventListener("click", () => download("zones.json", `${JSON.stringify(placesJson(), null, 1)}\n`));
  for (const [id, name, factor] of [["try-tilt", "tilt", Math.PI / 180], ["try-roll", "roll", Math.PI / 180], ["try-focal", "focal", 1]]) {
    $(id).addEventListener("input", () => {
      if (Number.isFinite($(id).valueAsNumber)) tryCamera({ [name]: $(id).valueAsNumber * factor });
    });
  }
  $("try-forget").addEventListener("click", forget);
  $("try-save").addEventListener("click", () => download("orientation.json", `${JSON.stringify(orientationJson(), null, 1)}\n`));
  $("known-save").addEventListener("click", () => download("landmarks.json", `${JSON.stringify(landmarksJson(knownMarks(world.marks)), null, 1)}\n`));
}

export function icon(name) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  made.setAttribute("aria-hidden", "true");
  made.setAttribute("class", "icon");
  const use = document.createElementNS("http://www.w3.org/2000/svg", "use");
  use.setAttribute("href", `#icon-${name}`);
  made.append(use);
  return made;
}

function startTabs() {
  const list = $("tabs");
  for (const name of TABS) {
    list.append(element("button", {
      id: `tab-${name}`, role: "tab", "aria-controls": `panel-${name}`, onclick: () => set("tab", name),
    }, name[0].toUpperCase() + name.slice(1)));
  }
  list.addEventListener("keydown", (event) => {
    const move = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!move) return;
    event.preventDefault();
    event.stopPropagation();
    set("tab", TABS[(TABS.indexOf(state.tab) + move + TABS.length) % TABS.length]);
    $(`tab-${state.tab}`).focus();
  });
  on("tab", () => {
    for (const name of TABS) {
      const chosen = name === state.tab;
      $(`tab-${name}`).setAttribute("aria-selected", String(chosen));
      $(`tab-${name}`).tabIndex = chosen ? 0 : -1;
      $(`panel-${name}`).hidden = !chosen;
    }
  });
  set("tab", "events");
}

function startLayers() {
  for (const [name, title, , key] of LAYERS) {
    if (name === "apart" && !world.data.site) continue;
    $("layers").append(element("button", {
      class: "chip", "data-layer": name, title: `${title} (${key.toUpperCase()})`, onclick: () => toggleLayer(name),
    }, title));
  }
  const show = () => {
    for (const chip of document.querySelectorAll("#layers .chip")) {
      chip.setAttribute("aria-pressed", String(state.layers[chip.dataset.layer]));
    }
  };
  on("layers", show);
  show();
}

export function toggleLayer(name) {
  state.layers[name] = !state.layers[name];
  tell("layers");
}

function showMarks() {
  const marks = world.marks.filter((mark) => mark.run === state.run);
  $("marks-none").hidden = marks.length > 0;
  $("marks-clear").hidden = marks.length === 0;
  $("marks").replaceChildren(...marks.map(markRow));
  showKnown();
}

function markRow(mark) {
  const { camera, clicks } = mark.sigma;
  const parts = [camera === null ? "the camera's error is not known" : `camera ± ${camera.toFixed(2)} m`];
  if (clicks !== null) parts.push(`pointing ± ${clicks.toFixed(2)} m`);
  const row = element("li", {},
    element("strong", { class: "figure" }, mark.text),
    element("span", { class: "soft" }, mark.upright ? "tall" : mark.points.length === 1 ? "from the camera" : "between two points"),
    element("span", { class: "soft" }, parts.join(", ")),
  );
  for (const { earth } of mark.points.filter((point) => point.earth)) row.append(earthRow(earth));
  if (mark.points.length === 2 && mark.points.every((point) => point.uv)) {
    const input = element("input", {
      type: "number", min: "0.01", step: "0.01", value: mark.known, "aria-label": `True ${mark.upright ? "height" : "length"} in metres`,
      oninput: () => {
        mark.known = input.value;
        showKnown();
      },
    });
    row.append(element("label", { class: "known" }, `True ${mark.upright ? "height" : "length"}, if you know it `, input, " m"));
  }
  return row;
}

function earthRow({ text, copied }) {
  return element("div", { class: "row earth" },
    element("span", { class: "figure soft" }, ...text.map((line) => element("div", {}, line))),
    element("button", { class: "quiet", "aria-label": `Copy ${copied}`, onclick: () => copy(copied) }, "Copy"),
  );
}

async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    announce(`${text} is copied.`);
  } catch {
    announce("This browser does not let the page copy: select the numbers instead.");
  }
}

function showKnown() {
  const known = knownMarks(world.marks);
  $("known").hidden = !known.length;
  $("known-command").textContent = known.length ? calibrateCommand("--landmarks", "landmarks.json") : "";
}

function showPlaces() {
  const camera = run() && run().said.camera;
  const here = world.places.filter((place) => !place.camera || place.camera === camera);
  $("places-none").hidden = here.length > 0;
  $("places-save").hidden = world.places.length === 0;
  $("places").replaceChildren(...here.map(placeRow));
}

const degrees = (radians) => (radians * 180) / Math.PI;

function showCamera() {
  const now = run();
  if (!now) return;
  const { said } = now.camera;
  const s = said.sigma;
  const rows = [
    ["Focal length", plusMinus(said.focal_px, s.focal_px, "px", 0)],
    ["Tilt", plusMinus(degrees(said.tilt_rad), s.tilt_deg, "°", 2)],
    ["Roll", plusMinus(degrees(said.roll_rad), s.roll_deg, "°", 2)],
    ["Height", plusMinus(said.height_m, s.height_m, "m", 2)],
    ["Picture", `${said.image_size[0]} × ${said.image_size[1]} px`],
    ["Method", said.method],
  ];
  if (said.people) rows.push(["Sightings", `${said.inliers} of ${said.people} agree`]);
  if (said.ground_error_m) rows.push(["Error within the scene", `${said.ground_error_m.median.toFixed(2)} m (median)`]);
  $("camera-facts").replaceChildren(...rows.map(([name, value]) => element("div", {}, element("dt", {}, name), element("dd", {}, value))));
  $("camera-warnings").replaceChildren(...said.warnings.map((text) => element("li", {}, text)));
  const tried = state.tried || { focal: said.focal_px, tilt: said.tilt_rad, roll: said.roll_rad };
  for (const [id, value, digits] of [["try-tilt", degrees(tried.tilt), 2], ["try-roll", degrees(tried.roll), 2], ["try-focal", tried.focal, 0]]) {
    if (document.activeElement !== $(id)) $(id).value = value.toFixed(digits);
  }
  $("tried").hidden = !state.tried;
  if (state.tried) $("tried-command").textContent = calibrateCommand("--orientation", "orientation.json");
}
