// Which way people and vehicles go over each cell of the ground, and how fast.
import { label, niceStep } from "./look.js";

const CELLS = 45; // at least along the longer side: arrows of some 12 px on a plan of 600
const SECTORS = 12;
const STANDING_MPS = 0.2;
const LEAST_S = 0.5; // who was there for less tells no direction
const LEAST_SHARE = 0.3; // of those who move there: two streams through a cell are two arrows
// From slow to fast, ever brighter, for every eye; a dark rim parts them from any ground.
const SPEEDS = ["#7b8cff", "#45b7e8", "#4fd6a0", "#b9e34d", "#fff04d"];

// Arrows as x, y, dx, dy in metres for each level of speed, and the speed of the fastest level.
export function flowField(rows, area, passes) {
  const [x0, y0, x1, y1] = area;
  const cell = niceStep(Math.max(x1 - x0, y1 - y0) / CELLS);
  const [w, h] = [Math.ceil((x1 - x0) / cell), Math.ceil((y1 - y0) / cell)];
  const sums = new Float32Array(3 * SECTORS * w * h);
  gather(rows, passes, (x, y, vx, vy) => {
    const [column, row] = [Math.floor((x - x0) / cell), Math.floor((y - y0) / cell)];
    if (!(column >= 0 && column < w && row >= 0 && row < h)) return;
    const sector = Math.floor(((Math.atan2(vy, vx) / (2 * Math.PI) + 1) * SECTORS) % SECTORS);
    const at = 3 * (SECTORS * (row * w + column) + sector);
    sums[at] += rows.step / 1000;
    sums[at + 1] += vx * (rows.step / 1000);
    sums[at + 2] += vy * (rows.step / 1000);
  });
  const found = [];
  for (let i = 0; i < w * h; i++) {
    const middle = [x0 + ((i % w) + 0.5) * cell, y0 + (Math.floor(i / w) + 0.5) * cell];
    for (const velocity of streams(sums.subarray(3 * SECTORS * i, 3 * SECTORS * (i + 1)))) found.push([...middle, ...velocity]);
  }
  return levelled(found, cell);
}

function gather(rows, passes, add) {
  const { x_m: x, y_m: y, vx_mps: vx, vy_mps: vy } = rows.columns;
  for (const one of rows.brief) {
    if (!passes(one)) continue;
    for (let i = rows.starts[one.k]; i < rows.starts[one.k + 1]; i++) {
      if (vx[i] * vx[i] + vy[i] * vy[i] > STANDING_MPS ** 2) add(x[i], y[i], vx[i], vy[i]);
    }
  }
}

// Mean velocities of the one or two directions in which most go.
function streams(sums) {
  const near = (s) => [s + SECTORS - 1, s, s + 1].map((one) => 3 * (one % SECTORS));
  const seconds = (s) => near(s).reduce((sum, at) => sum + sums[at], 0);
  let all = 0;
  for (let s = 0; s < SECTORS; s++) all += sums[3 * s];
  if (all < LEAST_S) return [];
  const most = Array.from({ length: SECTORS }, (_, s) => s).sort((a, b) => seconds(b) - seconds(a));
  const [first] = most;
  const other = most.find((s) => Math.min((s - first + SECTORS) % SECTORS, (first - s + SECTORS) % SECTORS) >= SECTORS / 4);
  return [first, other].filter((s) => seconds(s) >= Math.max(LEAST_S, LEAST_SHARE * all))
    .map((s) => [1, 2].map((k) => near(s).reduce((sum, at) => sum + sums[at + k], 0) / seconds(s)));
}

function levelled(found, cell) {
  const speeds = found.map((one) => Math.hypot(one[2], one[3])).sort((a, b) => a - b);
  const most = speeds.length ? speeds[Math.floor(0.95 * (speeds.length - 1))] : 1;
  const levels = SPEEDS.map(() => []);
  for (const [x, y, vx, vy] of found) {
    const speed = Math.hypot(vx, vy);
    const share = Math.min(1, speed / most);
    const long = cell * (0.35 + 0.5 * share);
    levels[Math.min(SPEEDS.length - 1, Math.floor(share * SPEEDS.length))].push([x, y, (vx / speed) * long, (vy / speed) * long]);
  }
  return { levels, most, cell };
}

// On the plan or in the picture: `to` says where a point of the ground is on the screen, or null.
export function paintFlow(context, { levels }, to) {
  levels.forEach((arrows, level) => {
    context.beginPath();
    for (const arrow of arrows) traceArrow(context, arrow, to);
    for (const [tint, wide] of [["rgba(12, 16, 22, 0.7)", 3.6], [SPEEDS[level], 1.8]]) {
      context.strokeStyle = tint;
      context.lineWidth = wide;
      context.stroke();
    }
  });
}

// Two streams of a cell keep to their right, so that neither hides the other.
function traceArrow(context, [x, y, dx, dy], to) {
  const [cx, cy] = [x + 0.18 * dy, y - 0.18 * dx];
  const at = (along, across) => to(cx + along * dx - across * dy, cy + along * dy + across * dx);
  const [tail, tip, left, right] = [at(-0.5, 0), at(0.5, 0), at(0.2, 0.2), at(0.2, -0.2)];
  if (!(tail && tip && left && right) || Math.hypot(tip[0] - tail[0], tip[1] - tail[1]) < 3) return;
  context.moveTo(...tail);
  context.lineTo(...tip);
  context.moveTo(...left);
  context.lineTo(...tip);
  context.lineTo(...right);
}

export function flowLegend(context, { most, levels }, x, y) {
  if (!levels.some((arrows) => arrows.length)) return label(context, "nobody moves here", x, y);
  const wide = label(context, "0", x, y);
  SPEEDS.forEach((tint, i) => {
    context.fillStyle = tint;
    context.fillRect(x + wide + 14 * i, y - 16, 14, 17);
  });
  return label(context, `${most.toFixed(1)} m/s`, x + wide + 14 * SPEEDS.length, y);
}
