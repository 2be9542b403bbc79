"use strict";
document.documentElement.classList.add("live");

function setUp(player) {
  const data = JSON.parse(player.querySelector("script").textContent);
  const slider = player.querySelector(".time"), clock = player.querySelector(".clock"), button = player.querySelector(".play");
  const bodies = [...player.querySelectorAll("[data-track]")];
  const cursors = [...player.querySelectorAll(".moves")];
  let playing = null;

  function show(frame) {
    for (const body of bodies) {
      const pose = data.tracks[body.dataset.track][frame];
      body.style.display = pose ? "" : "none";
      if (pose) body.setAttribute("transform", `translate(${pose[0]} ${pose[1]}) rotate(${pose[2]})`);
    }
    const time = data.times[frame];
    for (const cursor of cursors) {
      const left = +cursor.dataset.left, right = +cursor.dataset.right;
      const x = left + (right - left) * Math.min(1, time / cursor.dataset.end);
      cursor.setAttribute("x1", x);
      cursor.setAttribute("x2", x);
    }
    const text = `${time.toFixed(2)} s${frame < data.observed ? "" : ", predicted"}`;
    clock.textContent = text;
    slider.setAttribute("aria-valuetext", text);
  }

  function stop() {
    if (playing !== null) cancelAnimationFrame(playing);
    playing = null;
    button.textContent = "▶ Play";
    button.setAttribute("aria-pressed", "false");
  }

  function play() {
    const last = data.times.length - 1;
    const from = +slider.value >= last ? 0 : +slider.value;
    let began = null;
    button.textContent = "❚❚ Pause";
    button.setAttribute("aria-pressed", "true");
    function tick(now) {
      if (began === null) began = now;
      const time = data.times[from] + (now - began) / 1000;
      let frame = from;
      while (frame < last && data.times[frame + 1] <= time) frame++;
      slider.value = frame;
      show(frame);
      if (frame < last) playing = requestAnimationFrame(tick);
      else stop();
    }
    playing = requestAnimationFrame(tick);
  }

  slider.addEventListener("input", () => { stop(); show(+slider.value); });
  button.addEventListener("click", () => (playing === null ? play() : stop()));
  player.stopPlaying = stop;
  const begin = () => { stop(); slider.value = data.start; show(data.start); };
  player.querySelector(".worst")?.addEventListener("click", begin);
  begin();
}

const players = [...document.querySelectorAll(".player")];
players.forEach(setUp);
const choose = document.querySelector(".choose");
if (choose) {
  const videos = [...document.querySelectorAll(".video")];
  const pick = () => {
    players.forEach((p) => p.stopPlaying());
    videos.forEach((v, k) => { v.hidden = k !== +choose.value; });
  };
  choose.addEventListener("change", pick);
  pick();
}
