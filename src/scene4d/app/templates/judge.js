// Is the camera right? Uprights as it sees them, another horizon to try, and the command to run.
import { $, draw, run, set, state, world } from "./state.js";
import { heightBetween } from "./camera.js";
import { halo, label } from "./look.js";

const HANDLES = [0.12, 0.88];
const GRAB_PX = 18;
let held = null;

export function triedCamera() {
  const now = run();
  if (!state.tried || !now) return null;
  const { focal, tilt, roll } = state.tried;
  const camera = now.camera;
  const key = `${state.run} ${focal} ${tilt} ${roll}`;
  if (state.tried.made !== key) {
    const step = [Math.log(focal / camera.said.focal_px), tilt - camera.tilt, roll - camera.roll, 0, 0, 0, 0];
    state.tried.camera = camera.disturbed(step);
    state.tried.made = state.tried.key = key;
  }
  return state.tried.camera;
}

export function tryCamera(change) {
  const camera = run().camera;
  const before = state.tried || { focal: camera.said.focal_px, tilt: camera.tilt, roll: camera.roll };
  set("tried", { focal: before.focal, tilt: before.tilt, roll: before.roll, ...change });
}

export function forget() {
  set("tried", null);
}

// Ends of the horizon in undistorted pixels.
function handles(camera) {
  const [a, b, c] = camera.horizon;
  return HANDLES.map((share) => {
    const u = share * (camera.size[0] - 1);
    return [u, -(a * u + c) / b];
  });
}

const reachable = (uv, view) => {
  const [x, y] = view.to(...((triedCamera() || run().camera).distort(...uv) || uv));
  return [x, Math.max(10, Math.min(view.height - 10, y))];
};

export function grabHorizon(px, py, view) {
  const camera = triedCamera() || run().camera;
  const near = handles(camera).map((uv) => {
    const [x, y] = reachable(uv, view);
    return Math.hypot(x - px, y - py);
  });
  held = Math.min(...near) < GRAB_PX ? near.indexOf(Math.min(...near)) : null;
  return held !== null;
}

// The horizon through the pointer and the other end: tilt and roll at the same focal length.
export function dragHorizon(uv) {
  const camera = triedCamera() || run().camera;
  const ends = handles(camera);
  ends[held] = [ends[held][0], (camera.undistort(...uv) || uv)[1]];
  const [[u1, v1], [u2, v2]] = ends;
  const line = [v1 - v2, u2 - u1, u1 * v2 - u2 * v1];
  const K = camera.K;
  const up = [
    K[0][0] * line[0],
    K[0][1] * line[0] + K[1][1] * line[1],
    K[0][2] * line[0] + K[1][2] * line[1] + line[2],
  ];
  const sign = up[1] > 0 ? -1 : 1;
  const norm = Math.hypot(...up) * sign;
  const [x, y, z] = up.map((value) => value / norm);
  tryCamera({ tilt: Math.asin(Math.max(-1, Math.min(1, -z))), roll: Math.atan2(x, -y) });
}

export function judgeInPicture(context, view, now) {
  const camera = triedCamera() || now.camera;
  paintHandles(context, view, camera);
  const pointer = state.pointer;
  if (!pointer || !pointer.uv) return;
  const place = world.foot ? camera.locate(...world.foot.uv) : camera.locate(...pointer.uv);
  if (!place) return;
  const tall = world.foot ? heightBetween(camera, [world.foot.uv, pointer.uv]) : now.camera.said.person_height_m;
  const ends = [camera.project(...place, 0), camera.project(...place, tall)];
  if (!ends[0] || !ends[1]) return;
  const [[x1, y1], [x2, y2]] = ends.map((uv) => view.to(...uv));
  context.strokeStyle = "#ffc845";
  context.lineWidth = 3;
  context.beginPath();
  context.moveTo(x1, y1);
  context.lineTo(x2, y2);
  context.moveTo(x2 - 5, y2);
  context.lineTo(x2 + 5, y2);
  halo(context, () => context.stroke());
  context.beginPath();
  context.ellipse(x1, y1, 7, 4, 0, 0, 7);
  halo(context, () => context.stroke(), 2);
  const away = Math.hypot(place[0] - camera.centre[0], place[1] - camera.centre[1]);
  label(context, `${tall.toFixed(2)} m, ${away.toFixed(1)} m away`, x2 + 8, y2, { fill: "#ffc845" });
}

function paintHandles(context, view, camera) {
  const ends = handles(camera).map((uv) => reachable(uv, view));
  context.strokeStyle = "#1a1f26";
  context.lineWidth = 1;
  context.fillStyle = "#ffc845";
  for (const [x, y] of ends) {
    context.beginPath();
    context.arc(x, y, 7, 0, 7);
    halo(context, () => context.stroke(), 2);
    context.fill();
  }
}

const degrees = (radians) => (radians * 180) / Math.PI;

// What `calibrate --orientation` reads.
export function orientationJson() {
  const { focal, tilt, roll } = state.tried;
  const sigma = { focal_px: 0.03 * focal, tilt_deg: 0.5, roll_deg: 0.5 };
  return { focal_px: round(focal), tilt_deg: round(degrees(tilt)), roll_deg: round(degrees(roll)), sigma };
}

const round = (value) => Math.round(value * 1000) / 1000;

// What `calibrate --landmarks` reads: lengths and heights that are known, between clicked points.
export function landmarksJson(marks) {
  const seen = marks.map((mark) => ({ ...mark, uv: mark.points.map((point) => point.uv.map(round)), known: Number(mark.known) }));
  const distances = seen.filter((one) => !one.upright).map(({ uv, known }) => ({ uv, distance_m: known }));
  const uprights = seen.filter((one) => one.upright).map(({ uv, known }) => ({ foot_uv: uv[0], head_uv: uv[1], height_m: known }));
  return { schema: "scene4d/landmarks/1", distances, uprights };
}

export const knownMarks = (marks) =>
  marks.filter((mark) => mark.run === state.run && mark.points.length === 2 && Number(mark.known) > 0 && mark.points.every((point) => point.uv));

export function calibrateCommand(option, file) {
  const source = run().camera.said.source || "FOOTAGE";
  const quoted = /^[\w./:-]+$/.test(source) ? source : `'${source.replaceAll("'", "'\\''")}'`;
  return `scene4d calibrate ${quoted} ${option} ${file} --out again`;
}
