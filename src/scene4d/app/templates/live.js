// With a server: rows and footage are fetched, and what is new comes by itself.
import { $, announce, on, run, state, tell, world } from "./state.js";
import { Rows } from "./tracks.js";
import { addRun, standTogether } from "./main.js";
import { placesJson, readPlaces } from "./places.js";
import { sent } from "./search.js";

const OVERLAP_S = 8; // the newest rows are provisional: the smoother may still move them

export async function fetchRows(now, sinceS = null) {
  const since = sinceS === null ? "" : `?since_s=${sinceS}`;
  const answer = await fetch(`${world.data.api}/runs/${now.number}/rows${since}`);
  if (!answer.ok) throw new Error(`the rows of ${now.said.run} cannot be read`);
  return new Rows(await answer.json(), now.said.step_s);
}

// Everybody of a site once, fused over cameras.
async function fetchFused() {
  const answer = await fetch(`${world.data.api}/fused`);
  if (answer.ok) standTogether(await answer.json());
}

export function startLive() {
  if (!world.data.api) return;
  fetchPlaces();
  if (world.data.site) fetchFused();
  on("places-changed", savePlaces);
  const source = new EventSource(`${world.data.api}/live`);
  source.addEventListener("run", (event) => grown(JSON.parse(event.data)));
  source.addEventListener("fleet", (event) => {
    world.data.fleet = JSON.parse(event.data);
    tell("fleet");
  });
  source.addEventListener("alert", (event) => alerted(JSON.parse(event.data)));
  source.onopen = () => ($("live").dataset.state = "connected");
  source.onerror = () => ($("live").dataset.state = "lost");
  $("live").hidden = false;
}

// Cameras of a site may have runs of one name.
const isOf = (one, other) => one.run === other.run && one.camera === other.camera;

// A server tells of every run when it is connected, and then of those that change.
async function grown(said) {
  const now = world.runs.find((one) => isOf(one.said, said));
  if (!now) return begun(said);
  now.number = said.number; // a server that was started again may count them otherwise
  if (said.watched) {
    now.watched = said.watched;
    tell("searches");
  }
  if (said.version === now.said.version) return;
  if (!now.said.growing) return location.reload(); // tracked again: nothing of it need be as before
  now.grow(said);
  tell("fleet");
  if (!now.fetched) return;
  const live = state.ms >= now.end - 1500;
  const since = Math.max(0, now.rows.end / 1000 - OVERLAP_S);
  now.replaceRows(now.rows.merged(await fetchRows(now, since), 1000 * since));
  if (now === run()) {
    if (live && !state.playing) state.ms = now.end;
    tell("rows");
    tell("time");
  }
}

// A run that began after the page was opened; the first one makes another page of it.
async function begun(said) {
  const answer = await fetch(`${world.data.api}/scene`);
  if (!answer.ok) return;
  const { cameras, runs } = await answer.json();
  if (!world.runs.length) return void (runs.length && location.reload());
  for (const one of runs.filter((each) => !world.runs.some((known) => isOf(known.said, each)))) {
    addRun(one, cameras[one.camera]);
  }
  announce(`A new run of ${said.camera} has begun.`);
}

function alerted(event) {
  const now = world.runs.find((one) => one.said.run === event.run);
  if (!now) return;
  now.watched = now.watched.filter((one) => one.id !== event.id);
  if (event.state !== "withdrawn") now.watched.push(event);
  if (event.state === "provisional") announce(`${event.activity}: ${Object.entries(event.roles).map((pair) => pair.join(" ")).join(", ")}`);
  tell("searches");
}

async function fetchPlaces() {
  const answer = await fetch(`${world.data.api}/places`);
  if (!answer.ok) return;
  world.places = readPlaces(await answer.json());
  tell("places");
}

const savePlaces = () => sent("places", placesJson(), "PUT").catch((error) => announce(error.message));
