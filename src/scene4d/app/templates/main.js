// Begin: the data into runs, the parts of the page onto them.
import { $, draw, element, on, run, set, state, tell, world } from "./state.js";
import { Camera } from "./camera.js";
import { Run, Together } from "./run.js";
import { Rows } from "./tracks.js";
import { forgetColours } from "./look.js";
import { startPicture } from "./picture.js";
import { startPlan } from "./plan.js";
import { startTimeline } from "./timeline.js";
import { startClock } from "./clock.js";
import { loadVideo, loadView } from "./media.js";
import { startFleet } from "./fleet.js";
import { startTools } from "./tools.js";
import { startTables } from "./tables.js";
import { startPanel } from "./panel.js";
import { startSearch } from "./search.js";
import { readPlaces } from "./places.js";
import { fetchRows, startLive } from "./live.js";
import { startAgain } from "./again.js";
import { startAlerts } from "./alerts.js";
import { startKeys } from "./keys.js";

const FUSED_STEP_S = 0.2; // as Site.tracks

function showRun() {
  const now = run();
  loadView(now);
  loadVideo(now);
  $("run-choice").value = String(state.run);
  $("note").textContent = now.said.note || "";
  $("note").hidden = !now.said.note;
  $("picture").setAttribute("aria-label", `Footage of camera ${now.said.camera} with ${now.rows.brief.length} tracks drawn over it`);
  $("plan").setAttribute("aria-label", `The ground seen by camera ${now.said.camera} from above, in metres`);
  document.documentElement.style.setProperty("--picture-ratio", String(now.camera.size[0] / now.camera.size[1]));
  if (world.data.api && !now.fetched) {
    now.fetched = true;
    fetchRows(now).then((rows) => {
      now.replaceRows(rows);
      tell("rows");
      tell("run");
    });
  }
}

function startTheme() {
  const root = document.documentElement;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const show = (theme) => {
    root.dataset.theme = theme;
    forgetColours();
    draw();
  };
  show(dark.matches ? "dark" : "light");
  dark.addEventListener("change", () => show(dark.matches ? "dark" : "light"));
  $("theme").addEventListener("click", () => show(root.dataset.theme === "dark" ? "light" : "dark"));
}

export function addRun(said, camera) {
  const number = world.runs.length;
  world.runs.push(new Run(said, new Camera(camera), said.number ?? number));
  $("run-choice").append(element("option", { value: number }, `${said.camera}, ${said.run}`));
  $("choice").hidden = world.runs.length < 2;
}

export function standTogether(said) {
  world.fused = new Together(new Rows(said, FUSED_STEP_S), world.runs);
  draw();
}

// Nobody was tracked yet: the cameras that are watched, until somebody is.
function beginEmpty() {
  document.body.dataset.empty = "true";
  startTheme();
  startFleet();
  set("fleet", true, "fleet-shown");
  startLive();
}

function begin() {
  world.data = JSON.parse($("data").textContent);
  world.searches = world.data.searches || [];
  if (!world.data.runs.length) return beginEmpty();
  world.places = readPlaces(world.data.places);
  world.marks = [];
  world.data.runs.forEach((said) => addRun(said, world.data.cameras[said.camera]));
  $("run-choice").addEventListener("change", () => set("run", Number($("run-choice").value)));
  if (world.data.fused) standTogether(world.data.fused);
  startTheme();
  startPicture();
  startPlan();
  startTimeline();
  startClock();
  startTools();
  startTables();
  startPanel();
  startSearch();
  startKeys();
  startFleet();
  on("run", showRun);
  tell("run");
  for (const [name, reason] of Object.entries(world.data.unplaced)) {
    $("unplaced").append(element("li", {}, `${name} has no place in the site: ${reason}`));
  }
  if (world.data.site) world.runs.forEach(loadView);
  startLive();
  startAlerts();
  startAgain();
  document.documentElement.dataset.ready = "true";
}

begin();
