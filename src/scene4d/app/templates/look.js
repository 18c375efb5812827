// Colours from the style sheet, words and numbers for people.
let colours = null;

export function colour(name) {
  if (!colours) {
    const style = getComputedStyle(document.documentElement);
    colours = new Proxy({}, {
      get: (known, key) => (known[key] ??= style.getPropertyValue(`--${key}`).trim()),
    });
  }
  return colours[name];
}

export function forgetColours() {
  colours = null;
}

// On footage, which is dark or bright by itself, each kind has one bright colour with a dark rim.
export const ON_PICTURE = { person: "#56b4e9", wheels: "#35d0a3", vehicle: "#ffb454" };

export function metres(value, digits = 2) {
  return Number.isFinite(value) ? `${value.toFixed(digits)} m` : "unknown";
}

export function plusMinus(value, sigma, unit = "m", digits = null) {
  if (!Number.isFinite(value)) return "unknown";
  const shown = digits ?? (sigma > 0 ? Math.max(0, Math.min(2, 1 - Math.floor(Math.log10(sigma)))) : 2);
  const spread = Number.isFinite(sigma) && sigma !== null ? ` ± ${sigma.toFixed(shown)}` : "";
  return `${value.toFixed(shown)}${spread} ${unit}`;
}

export function clock(ms, run, tenths = true) {
  const start = run && run.said.start ? Date.parse(run.said.start) : null;
  if (start !== null) {
    const text = new Date(start + ms).toISOString();
    return text.slice(11, tenths ? 21 : 19);
  }
  return stopwatch(ms, tenths);
}

export function stopwatch(ms, tenths = true) {
  const total = Math.max(0, ms) / 1000;
  const hours = Math.floor(total / 3600);
  const minutes = String(Math.floor(total / 60) % 60).padStart(2, "0");
  const seconds = (total % 60).toFixed(tenths ? 1 : 0).padStart(tenths ? 4 : 2, "0");
  return `${hours ? `${hours}:` : ""}${minutes}:${seconds}`;
}

export function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= least * 0.999);
}

const TIME_STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200];

export function timeStep(leastMs) {
  return 1000 * (TIME_STEPS.find((step) => 1000 * step >= leastMs) || 86400);
}

export function halo(context, paint, width = 3, dark = "rgba(12, 16, 22, 0.65)") {
  const [stroke, line] = [context.strokeStyle, context.lineWidth];
  context.strokeStyle = dark;
  context.lineWidth = line + width;
  paint();
  context.strokeStyle = stroke;
  context.lineWidth = line;
  paint();
}

// Words on a dark ground, and how wide they are.
export function label(context, text, x, y, options = {}) {
  const { fill = "#fff", back = "rgba(16, 20, 26, 0.82)", align = "left" } = options;
  context.font = "600 11.5px system-ui, sans-serif";
  const wide = context.measureText(text).width + 10;
  const left = align === "center" ? x - wide / 2 : x;
  context.fillStyle = back;
  context.beginPath();
  context.roundRect(left, y - 16, wide, 17, 4);
  context.fill();
  context.fillStyle = fill;
  context.textBaseline = "alphabetic";
  context.textAlign = "left";
  context.fillText(text, left + 5, y - 3.5);
  return wide;
}
