// Events: those that were searched for, told while watching, or asked for now (serve).
import { $, announce, download, element, on, run, set, state, tell, world } from "./state.js";
import { clock, stopwatch } from "./look.js";
import { seek } from "./clock.js";
import { alertButton } from "./alerts.js";

export function startSearch() {
  on("run searches", gather);
  $("phrases").append(...world.data.phrases.map((phrase) => element("option", { value: phrase })));
  $("ask").hidden = !world.data.api;
  $("ask-none").hidden = Boolean(world.data.api);
  $("ask").addEventListener("submit", (event) => {
    event.preventDefault();
    ask($("words").value.trim());
  });
}

// An event on the page's clock; in a site its roles are identities.
function spanned(event, words) {
  const shift = (world.runs.find((one) => one.said.run === event.run) || { said: { shift_s: 0 } }).said.shift_s;
  const [begin, end] = [event.site_begin_s ?? event.begin_s + shift, event.site_end_s ?? event.end_s + shift];
  return { ...event, words, roles: event.identities || event.roles, begin: 1000 * begin, end: 1000 * end };
}

// The events of the run that is shown, in order of time, and the lists of all searches.
function gather() {
  const now = run();
  if (!now) return;
  const searched = world.searches.flatMap((one) => one.events.map((event) => spanned(event, one.words)));
  const told = now.watched.map((event) => spanned(event, event.activity));
  now.events = [...searched.filter((event) => event.run === now.said.run), ...told].sort((a, b) => a.begin - b.begin);
  const lists = world.searches.map((one, i) => searchList(one, i));
  if (told.length) lists.push(element("section", {}, element("h2", {}, "Told while watching"), eventList(told)));
  $("searches").replaceChildren(...lists);
}

function searchList(one, number) {
  const remove = element("button", { class: "quiet", "aria-label": `Forget the search ${one.words}`, onclick: () => {
    world.searches.splice(number, 1);
    tell("searches");
  } }, "Forget");
  return element("section", {},
    element("div", { class: "row" }, element("h2", {}, one.words), remove),
    element("details", {}, element("summary", {}, "Understood as"), ...one.understood.map((line) => element("p", { class: "soft" }, line))),
    element("p", { class: "soft" }, one.verdict),
    ...one.notes.map((line) => element("p", { class: "soft small" }, line)),
    eventList(one.events.map((event) => spanned(event, one.words))),
    element("div", { class: "row", hidden: !one.events.length }, element("span", { class: "soft" }, "Save"),
      ...["json", "csv", "actev"].map((form) => saveButton(one, form)),
    ),
    alertButton(one.words),
    world.data.api ? null : element("p", { class: "soft small" }, "For NIST's ActEV scorer: ", element("code", {}, actevCommand(one.words))),
  );
}

const FILES = { json: ["events.json", "JSON"], csv: ["events.csv", "CSV"], actev: ["actev.json", "ActEV"] };

// With a server, files are those of `scene4d search`; without one, the page writes what it can.
function saveButton(one, form) {
  const here = { json: () => JSON.stringify(one, null, 1), csv: () => csvOf(one.events) }[form];
  if (!world.data.api && !here) return null;
  const [name, title] = FILES[form];
  const save = async () => {
    try {
      download(name, world.data.api ? await (await sent("export", { words: one.words, format: form })).text() : here(), form === "csv" ? "text/csv" : undefined);
    } catch (error) {
      $("asked").textContent = error.message;
    }
  };
  return element("button", { class: "quiet", "aria-label": `Save ${title}`, onclick: save }, title);
}

const actevCommand = (words) => `scene4d search SCENE '${words.replaceAll("'", "'\\''")}' --actev actev.json`;

// What the server answers; a refusal is thrown as it says it.
export async function sent(path, said, method = "POST", signal = undefined) {
  const answer = await fetch(`${world.data.api}/${path}`, {
    method, signal, headers: { "Content-Type": "application/json" }, body: said === null ? undefined : JSON.stringify(said),
  });
  if (!answer.ok) throw new Error((await answer.json()).error.message);
  return answer;
}

const CSV = ["activity", "score", "probability", "begin_s", "end_s", "begin_time", "end_time", "camera", "run", "clip"];

// What a spreadsheet would take for a formula is given a quote in front.
function csvOf(events) {
  const roles = [...new Set(events.flatMap((event) => Object.keys(event.roles)))];
  const cell = (value) => {
    const text = value === null || value === undefined ? "" : String(value);
    const safe = typeof value === "string" && /^[=+@\t\r-]/.test(text) ? `'${text}` : text;
    return /[",\n\r]/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
  };
  const rows = events.map((event) => [...CSV.map((name) => event[name]), ...roles.map((role) => event.roles[role])]);
  return [[...CSV, ...roles], ...rows].map((row) => row.map(cell).join(",")).join("\r\n");
}

function eventList(events) {
  return element("ol", { class: "events" }, ...events.map((event) => element("li", {}, eventButton(event), why(event))));
}

function eventButton(event) {
  const number = world.runs.findIndex((one) => one.said.run === event.run);
  const roles = Object.entries(event.roles).map(([role, track]) => `${role} ${track}`).join(", ");
  const probability = event.probability === null || event.probability === undefined ? "" : `, probability ${event.probability.toFixed(2)}`;
  const when = number < 0 ? stopwatch(event.begin) : clock(event.begin, world.runs[number]);
  return element("button", { class: "event", onclick: () => goTo(event, number) },
    element("span", { class: "figure" }, when),
    element("span", {}, `${roles} for ${((event.end - event.begin) / 1000).toFixed(1)} s`),
    element("span", { class: "soft" }, `score ${event.score.toFixed(2)}${probability}`),
  );
}

function goTo(event, number) {
  if (number >= 0) set("run", number);
  set("selected", null);
  state.cast = Object.values(event.roles);
  seek(event.begin);
}

// Every predicate with its value, and over time where that is kept.
function why(event) {
  const list = element("ul", { class: "why" });
  for (const [name, value] of Object.entries(event.why || {})) {
    const course = event.course && event.course.values[name];
    list.append(element("li", {},
      element("span", { class: "small" }, name),
      element("span", { class: "small figure" }, value === null ? "cannot be judged" : value.toFixed(2)),
      course ? spark(event, course) : null,
    ));
  }
  return element("details", {}, element("summary", {}, "Why"), list);
}

function spark(event, values) {
  const times = event.course.time_s;
  const [first, last] = [times[0], times[times.length - 1]];
  const x = (s) => ((s - first) / Math.max(last - first, 1e-9)) * 200;
  const make = (name, attributes) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    return made;
  };
  const svg = make("svg", { viewBox: "0 0 200 26", class: "spark", "aria-hidden": "true", preserveAspectRatio: "none" });
  svg.append(make("rect", { x: x(event.begin_s), y: 0, width: Math.max(1, x(event.end_s) - x(event.begin_s)), height: 26, class: "during" }));
  const points = values.map((value, i) => (value === null ? null : `${x(times[i]).toFixed(1)},${(24 - 22 * value).toFixed(1)}`));
  svg.append(make("polyline", { points: points.filter(Boolean).join(" "), class: "course" }));
  return svg;
}

let asking = null; // what ends the search that runs

async function ask(words) {
  if (asking) return asking.abort();
  if (!words) return;
  $("asked").textContent = "Searching";
  $("ask-button").textContent = "Stop";
  asking = new AbortController();
  try {
    const said = await (await sent("search", { words }, "POST", asking.signal)).json();
    for (const one of said.searches.reverse()) world.searches.unshift(one);
    const found = said.searches.reduce((sum, one) => sum + one.events.length, 0);
    $("asked").textContent = "";
    announce(`${found} event${found === 1 ? "" : "s"} found.`);
    tell("searches");
  } catch (error) {
    $("asked").textContent = error.name === "AbortError" ? "The search was stopped." : error.message;
  }
  asking = null;
  $("ask-button").textContent = "Search";
}
