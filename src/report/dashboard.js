"use strict";
const live = document.getElementById("live"), fresh = document.getElementById("fresh");

async function again() {
  if (document.hidden) return;
  try {
    const reply = await fetch(location.href);
    if (!reply.ok) throw new Error(reply.statusText);
    const page = new DOMParser().parseFromString(await reply.text(), "text/html");
    const now = page.getElementById("live");
    // What has not changed is left alone: the focus and a selection stay.
    if (now.innerHTML !== live.innerHTML) live.replaceChildren(...now.childNodes);
    fresh.textContent = "live";
  } catch {
    fresh.textContent = "the service does not answer; trying again";
  }
}

fresh.textContent = "live";
setInterval(again, 2000);
