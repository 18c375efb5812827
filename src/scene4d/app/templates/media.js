// Footage and empty views of runs: out of the page, or from the server.
import { $, draw, element, tell, world } from "./state.js";
import { bytesOf } from "./packed.js";
import { follow } from "./clock.js";
import { inPieces } from "./pieces.js";

function source(now, kind, type) {
  const api = world.data.api;
  if (api) return now.said[kind] ? `${api}/runs/${now.number}/${kind}` : null;
  const holder = $(`${kind}-${now.number}`);
  return holder ? URL.createObjectURL(new Blob([bytesOf(holder.textContent)], { type })) : null;
}

export function loadView(now) {
  if (now.viewAsked) return;
  now.viewAsked = true;
  const view = source(now, "view", "image/jpeg");
  if (!view) return;
  const image = new Image();
  image.onload = () => {
    now.view = image;
    now.viewReady = true;
    tell("fleet");
    draw();
  };
  image.src = view;
}

export function loadVideo(now) {
  if (now.videoAsked) return;
  now.videoAsked = true;
  const video = source(now, "video", "video/mp4");
  if (!video) return;
  const player = element("video", { preload: "auto", playsinline: true });
  player.muted = true;
  now.video = player;
  player.addEventListener("error", () => (now.video = null));
  follow(now);
  if (world.data.api) fetchVideo(player, `${world.data.api}/runs/${now.number}`);
  else player.src = video;
}

async function fetchVideo(player, address) {
  const about = await (await fetch(`${address}/pieces`)).json();
  player.src = about.starts_s ? inPieces(player, about, `${address}/pieces`) : `${address}/video`;
}
