// The keyboard, and its table.
import { $, LAYERS, element, set, state, world } from "./state.js";
import { step, toEvent, toggle } from "./clock.js";
import { TOOLS } from "./tools.js";
import { finishPlace } from "./places.js";
import { toggleLayer } from "./panel.js";
import { pictureView } from "./picture.js";
import { planView } from "./plan.js";
import { toggleFleet } from "./fleet.js";

const FRAME_MS = 100;
const KEYS = [
  ["Space", "play or pause"], ["← →", "a tenth of a second back or on; with Shift one second"],
  ["N, P", "next, previous event"], ["+ −", "faster, slower"],
  ...TOOLS.map(([, title, key]) => [key.toUpperCase(), `tool: ${title.toLowerCase()}`]),
  ["Enter, Esc", "end or drop what is being drawn"],
  ...LAYERS.map(([, title, , key]) => [key.toUpperCase(), `layer: ${title.toLowerCase()}`]),
  ["C", "all cameras"], ["R", "both views whole again"], ["?", "this table"],
];

export function startKeys() {
  $("keys").replaceChildren(...KEYS.map(([key, text]) => element("div", {}, element("dt", {}, element("kbd", {}, key)), element("dd", {}, text))));
  $("help").addEventListener("click", () => $("helping").showModal());
  document.addEventListener("keydown", pressed);
}

function pressed(event) {
  const target = event.target;
  if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(target.tagName)) return;
  if (event.key === " " && /^(BUTTON|SUMMARY)$/.test(target.tagName)) return;
  if (event.key === "Enter" && target.tagName === "BUTTON") return;
  const action = actionOf(event);
  if (!action) return;
  event.preventDefault();
  action();
}

function actionOf(event) {
  const far = event.shiftKey ? 10 * FRAME_MS : FRAME_MS;
  const layer = LAYERS.find(([, , , key]) => key === event.key.toLowerCase());
  if (layer) return () => toggleLayer(layer[0]);
  const tool = TOOLS.find(([, , key]) => key === event.key.toLowerCase());
  if (tool) return () => set("tool", tool[0]);
  return {
    " ": toggle, ArrowLeft: () => step(-far), ArrowRight: () => step(far),
    n: () => toEvent(1), p: () => toEvent(-1), "+": () => faster(2), "-": () => faster(0.5),
    "?": () => $("helping").showModal(), Enter: finishPlace, Escape: drop,
    c: toggleFleet, r: () => [pictureView(), planView()].forEach((view) => view.reset()),
  }[event.key.length === 1 ? event.key.toLowerCase() : event.key];
}

function faster(factor) {
  set("speed", Math.max(0.25, Math.min(16, state.speed * factor)));
}

function drop() {
  if (world.draft) world.draft = null;
  else set("selected", null);
  state.cast = [];
  set("tool", "look");
}
