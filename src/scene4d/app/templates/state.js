// What the page shows at the moment, and who is told when it changes.
const listeners = new Map();

// Name, title, whether it is on at first, and its key.
export const LAYERS = [
  ["boxes", "Boxes", true, "1"], ["feet", "Feet", true, "2"], ["paths", "Paths", true, "3"],
  ["cuboids", "Cuboids", false, "4"], ["sigma", "Uncertainty", false, "5"], ["grid", "Ground grid", false, "6"],
  ["horizon", "Horizon", false, "7"], ["heat", "Heat map", false, "8"], ["flow", "Flow", false, "f"],
  ["uprights", "Uprights", false, "9"], ["photo", "Plan photo", true, "0"], ["apart", "Each camera's own", false, "a"],
];

export const state = {
  run: 0, ms: 0, playing: false, speed: 1, tool: "look",
  hover: null, selected: null, cast: [], pointer: null,
  layers: Object.fromEntries(LAYERS.map(([name, , on]) => [name, on])),
  filter: { kind: "all", fastest: 0, path: 0, words: "", zone: "", lasting: 0 },
  tried: null, span: null, fleet: false,
};

// `fused` is everybody of a site once; null for a scene.
export const world = { data: null, runs: [], fused: null };

export function on(names, listener) {
  for (const name of names.split(" ")) {
    if (!listeners.has(name)) listeners.set(name, []);
    listeners.get(name).push(listener);
  }
}

export function tell(name) {
  for (const listener of listeners.get(name) || []) listener();
  if (name !== "draw") draw();
}

export function set(name, value, told = name) {
  if (state[name] === value) return;
  state[name] = value;
  tell(told);
}

let asked = false;
export function draw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    tell("draw");
  });
}

export function run() {
  return world.runs[state.run];
}

// Whether a track is pointed at, chosen, or in the event that is looked at.
export const isLit = (track) => state.hover === track || isChosen(track);

export const isChosen = (track) => state.selected === track || state.cast.includes(track);

export function passes(brief) {
  const filter = state.filter;
  if (filter.kind !== "all" && brief.kind !== filter.kind) return false;
  if (brief.fastest < filter.fastest || brief.path < filter.path) return false;
  if (brief.end - brief.begin < 1000 * filter.lasting) return false;
  if (filter.zone && !brief.wasIn(filter.zone)) return false;
  return !filter.words || `${brief.class} ${brief.track} ${brief.colours.flat().join(" ")}`.includes(filter.words.toLowerCase());
}

export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value === true) made.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(key, value);
  }
  made.append(...children.filter((child) => child !== null));
  return made;
}

export const $ = (id) => document.getElementById(id);

let announced = 0;
export function announce(text) {
  $("said").textContent = text;
  $("toast").textContent = text;
  $("toast").classList.add("shown");
  clearTimeout(announced);
  announced = setTimeout(() => $("toast").classList.remove("shown"), 4000);
}

export function download(name, text, kind = "application/json") {
  const link = element("a", { href: URL.createObjectURL(new Blob([text], { type: kind })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
