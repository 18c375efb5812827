// One clock for the picture, the plan and the timeline: the video's own while it plays.
import { $, draw, on, run, set, state, tell, world } from "./state.js";
import { clock, stopwatch } from "./look.js";

let pending = null;
let last = 0;
let frameMs = null;

export function startClock() {
  on("run", () => {
    pauseAll();
    seek(Math.max(run().begin, Math.min(run().end, state.ms)));
  });
  on("speed", () => {
    for (const now of [run()]) if (now && now.video) now.video.playbackRate = state.speed;
    $("speed").value = String(state.speed);
  });
  $("play").addEventListener("click", toggle);
  $("back").addEventListener("click", () => toEvent(-1));
  $("next").addEventListener("click", () => toEvent(1));
  $("speed").addEventListener("change", () => set("speed", Number($("speed").value)));
  on("time run", showTime);
  on("playing", () => {
    $("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
    $("play").dataset.playing = String(state.playing);
  });
}

function showTime() {
  const now = run();
  if (!now) return;
  $("now").textContent = clock(state.ms, now);
  $("whole").textContent = clock(now.end, now);
  const line = $("timeline");
  line.setAttribute("aria-valuemin", String(Math.round(now.begin / 1000)));
  line.setAttribute("aria-valuemax", String(Math.round(now.end / 1000)));
  line.setAttribute("aria-valuenow", String(Math.round(state.ms / 1000)));
  line.setAttribute("aria-valuetext", `${stopwatch(state.ms)} of ${stopwatch(now.end)}, ${now.there().length} there`);
}

// Called once a run's video can be played.
export function follow(now) {
  const video = now.video;
  video.addEventListener("seeked", () => {
    if (pending !== null) {
      video.currentTime = pending;
      pending = null;
    }
    draw();
  });
  video.addEventListener("loadeddata", () => draw());
  video.addEventListener("ended", () => pause());
  if (video.requestVideoFrameCallback) {
    const each = (_, data) => {
      if (now === run()) frameMs = 1000 * (data.mediaTime + now.said.shift_s);
      video.requestVideoFrameCallback(each);
      draw();
    };
    video.requestVideoFrameCallback(each);
  }
  video.currentTime = Math.max(0, state.ms / 1000 - now.said.shift_s);
}

export function seek(ms) {
  const now = run();
  if (!now) return;
  state.ms = Math.max(now.begin, Math.min(now.end, ms));
  const video = now.video;
  if (video) {
    const s = Math.max(0, Math.min(state.ms / 1000 - now.said.shift_s, (video.duration || Infinity) - 0.001));
    if (video.seeking) pending = s; else video.currentTime = s;
  }
  last = performance.now();
  tell("time");
}

export function toggle() {
  if (state.playing) pause(); else play();
}

export function pause() {
  const now = run();
  if (now && now.video) now.video.pause();
  set("playing", false);
}

function pauseAll() {
  for (const one of world.runs) if (one.video) one.video.pause();
  set("playing", false);
}

async function play() {
  const now = run();
  if (!now) return;
  if (state.ms >= now.end - 50) seek(now.begin);
  set("playing", true);
  last = performance.now();
  if (now.video) {
    now.video.playbackRate = state.speed;
    try {
      await now.video.play();
    } catch {
      now.video = null; // what cannot be decoded is shown as the empty view
    }
  }
  requestAnimationFrame(tick);
}

function tick() {
  const now = run();
  if (!state.playing || !now) return;
  const time = performance.now();
  if (now.video && !now.video.paused) {
    const ms = 1000 * (now.video.currentTime + now.said.shift_s);
    state.ms = frameMs !== null && Math.abs(frameMs - ms) < 250 ? frameMs : ms;
  } else if (!now.video) {
    state.ms += (time - last) * state.speed;
  }
  last = time;
  if (state.ms >= now.end) {
    state.ms = now.end;
    pause();
  }
  tell("time");
  requestAnimationFrame(tick);
}

export function step(ms) {
  pause();
  seek(state.ms + ms);
}

export function toEvent(direction) {
  const now = run();
  const starts = now.events.length ? now.events.map((one) => one.begin) : now.rows.brief.map((one) => one.begin);
  const others = starts.filter((ms) => (direction > 0 ? ms > state.ms + 20 : ms < state.ms - 20));
  if (!others.length) return;
  seek(direction > 0 ? Math.min(...others) : Math.max(...others));
}
