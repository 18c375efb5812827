// Footage in pieces, as the place that is looked at needs them: what a browser cannot play as it is.
import { draw } from "./state.js";

const KEPT = 24; // pieces: the farthest are dropped

// The address of a video of these pieces, and what begins to fetch them.
export function inPieces(video, about, address) {
  const source = new MediaSource();
  const starts = about.starts_s;
  const have = new Set();
  let buffer = null;
  let fetching = false;
  const at = (s) => Math.max(0, starts.findLastIndex((start) => start <= s + 1e-3));
  const bounds = (k) => [starts[k], k + 1 < starts.length ? starts[k + 1] : about.end_s];

  async function pump() {
    if (!buffer || buffer.updating || fetching || source.readyState !== "open") return;
    const now = at(video.currentTime);
    if (have.size > KEPT) {
      const farthest = [...have].reduce((a, b) => (Math.abs(a - now) > Math.abs(b - now) ? a : b));
      have.delete(farthest);
      return buffer.remove(...bounds(farthest));
    }
    const next = [now, now + 1, now + 2].find((k) => k < starts.length && !have.has(k));
    if (next === undefined) return;
    fetching = true;
    try {
      const answer = await fetch(`${address}/${next}`);
      if (!answer.ok) throw new Error("no footage");
      const piece = await answer.arrayBuffer();
      have.add(next);
      buffer.timestampOffset = Number(answer.headers.get("X-Offset-S"));
      buffer.appendBuffer(piece);
    } catch {
      if (source.readyState === "open") source.endOfStream("network"); // the empty view is shown
    }
    fetching = false;
  }

  source.addEventListener("sourceopen", () => {
    source.duration = about.end_s;
    buffer = source.addSourceBuffer(about.type);
    buffer.addEventListener("updateend", () => {
      draw();
      pump();
    });
    pump();
  }, { once: true });
  for (const kind of ["seeking", "timeupdate"]) video.addEventListener(kind, pump);
  return URL.createObjectURL(source);
}
