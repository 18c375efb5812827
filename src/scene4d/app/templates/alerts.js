// Searches that stand: whoever watches the scene looks for them, and tells what is found (serve).
import { $, announce, element, tell, world } from "./state.js";
import { sent } from "./search.js";

export async function startAlerts() {
  if (!world.data.api) return;
  world.alerts = (await (await fetch(`${world.data.api}/alerts`)).json()).searches || [];
  show();
  tell("searches");
}

async function change(words, method) {
  try {
    world.alerts = (await (await sent("alerts", { words }, method)).json()).searches;
    announce(method === "PUT" ? `Whoever watches this scene now looks for: ${words}.` : `No longer looked for: ${words}.`);
  } catch (error) {
    announce(error.message);
  }
  show();
  tell("searches");
}

function show() {
  $("alerts").hidden = !world.alerts.length;
  $("alerts-list").replaceChildren(...world.alerts.map((words) => element("li", {},
    element("span", { class: "name" }, words),
    element("button", { class: "quiet", "aria-label": `No longer look for ${words}`, onclick: () => change(words, "DELETE") }, "Remove"),
  )));
}

// For a search that was made: keep it.
export function alertButton(words) {
  if (!world.alerts || world.alerts.includes(words) || world.data.site) return null;
  return element("button", { class: "quiet", onclick: () => change(words, "PUT") }, "Tell me when it happens");
}
