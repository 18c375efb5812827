// Zones and lines: drawn, named, and written as the JSON that `search --zones` reads.
import { $, announce, element, run, set, state, tell, world } from "./state.js";

export function placesHere() {
  const camera = run() && run().said.camera;
  return world.places.filter((place) => !place.camera || place.camera === camera);
}

export function addPoint(xy) {
  world.draft ??= { kind: state.tool, points: [] };
  const points = world.draft.points;
  const last = points[points.length - 1];
  if (!last || Math.hypot(last[0] - xy[0], last[1] - xy[1]) > 0.02) points.push(xy.map((value) => Math.round(value * 1000) / 1000));
  tell("draft");
}

const crosses = (a, b, c, d) => {
  const side = (p, q, r) => Math.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]));
  return side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0;
};

function crossesItself(points) {
  const n = points.length;
  for (let i = 0; i < n; i++) {
    for (let j = i + 2; j < n; j++) {
      if (i === 0 && j === n - 1) continue;
      if (crosses(points[i], points[(i + 1) % n], points[j], points[(j + 1) % n])) return true;
    }
  }
  return false;
}

export function finishPlace() {
  const draft = world.draft;
  if (!draft) return;
  const least = draft.kind === "zone" ? 3 : 2;
  if (draft.points.length < least) return announce(`A ${draft.kind} needs ${least} points.`);
  if (draft.kind === "zone" && crossesItself(draft.points)) return announce("The zone crosses itself: draw it again.");
  askName(draft);
}

function askName(draft) {
  const dialog = $("naming");
  const input = $("place-name");
  $("naming-title").textContent = `Name this ${draft.kind}`;
  input.value = `${draft.kind} ${world.places.filter((place) => place.kind === draft.kind).length + 1}`;
  dialog.onclose = () => {
    const name = input.value.trim();
    world.draft = null;
    if (dialog.returnValue === "save" && name) keep({ ...draft, name });
    tell("places");
    set("tool", "look");
  };
  dialog.returnValue = "";
  dialog.showModal();
  input.select();
}

function keep(place) {
  let name = place.name;
  for (let n = 2; world.places.some((one) => one.name.toLowerCase() === name.toLowerCase()); n++) name = `${place.name} ${n}`;
  world.places.push({ kind: place.kind, name, points: place.points, camera: world.data.site ? null : run().said.camera });
  announce(`${place.kind === "zone" ? "Zone" : "Line"} ${name} is drawn.`);
  set("tab", "places");
  tell("places-changed");
}

export function remove(place) {
  world.places = world.places.filter((one) => one !== place);
  tell("places");
  tell("places-changed");
}

// {"zones": {NAME: {"camera": .., "points": [[x, y], ..]}}, "lines": {..}}
export function placesJson() {
  const of = (kind) => Object.fromEntries(world.places.filter((one) => one.kind === kind).map((one) => [
    one.name, one.camera ? { camera: one.camera, points: one.points } : { points: one.points },
  ]));
  const said = { zones: of("zone"), lines: of("line") };
  for (const key of ["zones", "lines"]) if (!Object.keys(said[key]).length) delete said[key];
  return said;
}

export function readPlaces(said) {
  const of = (key, kind) => Object.entries((said && said[key]) || {}).map(([name, place]) => ({
    kind, name, camera: place.camera || null, points: Array.isArray(place) ? place : place.points,
  }));
  return [...of("zones", "zone"), ...of("lines", "line")];
}

export function areaOfZone(points) {
  let sum = 0;
  points.forEach(([x, y], i) => {
    const [p, q] = points[(i + 1) % points.length];
    sum += x * q - p * y;
  });
  return Math.abs(sum) / 2;
}

export const lengthOfLine = (points) =>
  points.slice(1).reduce((sum, point, i) => sum + Math.hypot(point[0] - points[i][0], point[1] - points[i][1]), 0);

export function placeRow(place) {
  const size = place.kind === "zone" ? `${areaOfZone(place.points).toFixed(1)} m²` : `${lengthOfLine(place.points).toFixed(1)} m`;
  return element("li", {},
    element("span", { class: "name" }, place.name),
    element("span", { class: "soft" }, `${place.kind}, ${size}`),
    element("button", { class: "quiet", "aria-label": `Remove ${place.name}`, onclick: () => remove(place) }, "Remove"),
  );
}
