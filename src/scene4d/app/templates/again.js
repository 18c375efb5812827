// Calibrate again from the page, with what is known of the camera (serve).
import { $, element, on, run, set, world } from "./state.js";
import { knownMarks, landmarksJson, orientationJson } from "./judge.js";
import { plusMinus } from "./look.js";
import { sent } from "./search.js";

const ASKED_MS = 1000;
const degrees = (radians) => (radians * 180) / Math.PI;

export function startAgain() {
  if (!world.data.api) return;
  for (const [id, said] of [
    ["tried-run", () => ({ orientation: orientationJson() })],
    ["known-run", () => ({ landmarks: landmarksJson(knownMarks(world.marks)) })],
  ]) {
    $(id).hidden = false;
    $(id).addEventListener("click", () => begin(said()));
  }
  $("again-cancel").addEventListener("click", () => change(() => sent("calibration", {}, "DELETE")));
  on("run", show);
  change(() => fetch(`${world.data.api}/calibration`));
}

function begin(said) {
  set("tab", "camera");
  change(() => sent(`runs/${run().number}/calibration`, said));
}

async function change(asking) {
  try {
    world.again = await (await asking()).json();
  } catch (error) {
    world.again = { state: "failed", run: run().number, error: { message: error.message } };
  }
  show();
  if (world.again.state === "running") setTimeout(() => change(() => fetch(`${world.data.api}/calibration`)), ASKED_MS);
}

function show() {
  const said = world.again || { state: "none" };
  const here = said.state !== "none" && said.run === run().number;
  $("again").hidden = !here;
  if (!here) return;
  const running = said.state === "running";
  const share = running && said.share !== null ? ` ${Math.round(100 * said.share)} %` : "";
  $("again-said").textContent = { running: `${said.stage}${share}`, failed: said.error && said.error.message, done: `Written to ${said.file}, beside the camera that is used. Track with it: scene4d track FOOTAGE --camera ${said.file} --out NEW` }[said.state];
  $("again-cancel").hidden = !running;
  $("again-table").replaceChildren(...(said.state === "done" ? compared(said.before, said.camera) : []));
}

// Both cameras, each with its errors.
function compared(before, after) {
  const rows = [
    ["Focal length, px", (one) => plusMinus(one.focal_px, one.sigma.focal_px, "", 0)],
    ["Tilt, °", (one) => plusMinus(degrees(one.tilt_rad), one.sigma.tilt_deg, "", 2)],
    ["Roll, °", (one) => plusMinus(degrees(one.roll_rad), one.sigma.roll_deg, "", 2)],
    ["Height, m", (one) => plusMinus(one.height_m, one.sigma.height_m, "", 2)],
    ["Error within the scene, m", (one) => (one.ground_error_m ? one.ground_error_m.median.toFixed(2) : "not known")],
    ["People who agree", (one) => (one.people ? `${one.inliers} of ${one.people}` : "not known")],
  ];
  const cell = (kind, text) => element(kind, kind === "th" ? { scope: "col" } : {}, text);
  return [
    element("thead", {}, element("tr", {}, ...["", "Used now", "New"].map((text) => cell(text ? "th" : "td", text)))),
    element("tbody", {}, ...rows.map(([name, of]) => element("tr", {}, element("th", { scope: "row" }, name), cell("td", of(before)), cell("td", of(after))))),
  ];
}
