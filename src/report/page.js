"use strict";
document.documentElement.classList.add("live");

function setUp(player) {
  const data = JSON.parse(player.querySelector(".motion").textContent);
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
    document.querySelectorAll(".seen-frames").forEach((seen) => seen.showFrame?.());
  };
  choose.addEventListener("change", pick);
  pick();
}

// Frames of a video: a slider moves the row, and follows it.
for (const seen of document.querySelectorAll(".seen-frames")) {
  const slider = seen.querySelector(".frame"), row = seen.querySelector(".stills"), frames = [...row.children];
  const left = (frame) => frame.offsetLeft - frames[0].offsetLeft;
  const show = () => row.scrollTo({ left: left(frames[+slider.value]) });
  slider.addEventListener("input", show);
  seen.showFrame = show;
  show();
  row.addEventListener("scroll", () => {
    if (document.activeElement === slider) return;
    const far = frames.map((frame) => Math.abs(left(frame) - row.scrollLeft));
    slider.value = far.indexOf(Math.min(...far));
  }, { passive: true });
}

// Pictures: values under the pointer, zoom, and files to keep.
const PNG_SCALE = 3, NEAR = 24, STEP = 1.5;

function save(name, type, content) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

const quoted = (cell) => (/[",\n]/.test(cell) ? `"${String(cell).replaceAll('"', '""')}"` : String(cell ?? ""));
const csv = (rows) => rows.map((row) => row.map(quoted).join(",")).join("\n") + "\n";

function alone(svg, box) {
  const copy = svg.cloneNode(true);
  copy.setAttribute("viewBox", box.join(" "));
  copy.setAttribute("width", box[2]);
  copy.setAttribute("height", box[3]);
  const make = (name) => document.createElementNS("http://www.w3.org/2000/svg", name);
  const style = make("style"), paper = make("rect");
  style.textContent = document.getElementById("picture-style").textContent;
  paper.setAttribute("class", "paper");
  for (const [key, k] of [["x", 0], ["y", 1], ["width", 2], ["height", 3]]) paper.setAttribute(key, box[k]);
  copy.prepend(style, paper);
  return new XMLSerializer().serializeToString(copy);
}

function savePng(svg, box, name) {
  const image = new Image();
  image.onload = () => {
    const canvas = document.createElement("canvas");
    canvas.width = PNG_SCALE * box[2];
    canvas.height = PNG_SCALE * box[3];
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    canvas.toBlob((blob) => save(name, "image/png", blob));
  };
  image.src = "data:image/svg+xml;charset=utf-8," + encodeURIComponent(alone(svg, box));
}

function tools(figure) {
  const svg = figure.querySelector("svg.picture"), script = figure.querySelector("script.data");
  if (!svg) return;
  const whole = svg.getAttribute("viewBox").split(" ").map(Number), name = figure.dataset.name || "picture";
  const data = script ? JSON.parse(script.textContent) : null;
  let box = [...whole], drag = null;
  const bar = document.createElement("div");
  bar.className = "tools";
  const add = (text, label, act) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = text;
    button.setAttribute("aria-label", `${label}: ${name}`);
    button.addEventListener("click", act);
    bar.append(button);
  };
  const look = (next) => { box = next; svg.setAttribute("viewBox", box.join(" ")); svg.classList.toggle("zoomed", box[2] < whole[2]); };
  const zoom = (factor, x = box[0] + box[2] / 2, y = box[1] + box[3] / 2) => {
    const next = [x - (x - box[0]) / factor, y - (y - box[1]) / factor, box[2] / factor, box[3] / factor];
    look(next[2] < whole[2] ? next : [...whole]);
  };
  add("+", "zoom in", () => zoom(STEP));
  add("−", "zoom out", () => zoom(1 / STEP));
  add("1:1", "whole picture", () => look([...whole]));
  if (data) add("CSV", "numbers as CSV", () => save(`${name}.csv`, "text/csv",
    csv([["series", ...data.columns], ...data.series.flatMap((s) => s.rows.map((row) => [s.name, ...row.slice(0, -2)]))])));
  add("SVG", "save as SVG", () => save(`${name}.svg`, "image/svg+xml", alone(svg, box)));
  add("PNG", "save as PNG", () => savePng(svg, box, `${name}.png`));
  figure.append(bar);

  const at = (event) => {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [point.x, point.y];
  };
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.hidden = true;
  figure.append(tip);
  svg.addEventListener("pointermove", (event) => {
    const [x, y] = at(event);
    if (drag) return look([box[0] + drag[0] - x, box[1] + drag[1] - y, box[2], box[3]]);
    let best = null, least = NEAR * box[2] / whole[2];
    for (const s of data?.series ?? []) for (const row of s.rows) {
      const far = Math.hypot(row.at(-2) - x, row.at(-1) - y);
      if (far < least) [least, best] = [far, [s, row]];
    }
    tip.hidden = !best;
    if (!best) return;
    const [s, row] = best;
    tip.textContent = [s.name, ...data.columns.map((c, k) => `${c} ${row[k] === null ? "–" : +row[k].toPrecision(4)}`)].join(" · ");
    const frame = figure.getBoundingClientRect();
    tip.style.left = `${Math.min(event.clientX - frame.left + 12, Math.max(0, frame.width - tip.offsetWidth))}px`;
    tip.style.top = `${event.clientY - frame.top + 14}px`;
  });
  svg.addEventListener("pointerleave", () => { tip.hidden = true; });
  svg.addEventListener("pointerdown", (event) => {
    if (box[2] >= whole[2]) return;
    drag = at(event);
    svg.setPointerCapture(event.pointerId);
  });
  for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { drag = null; });
  svg.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    zoom(event.deltaY < 0 ? STEP : 1 / STEP, ...at(event));
  }, { passive: false });
}
document.querySelectorAll("figure").forEach(tools);

for (const table of document.querySelectorAll("details.numbers")) {
  const button = document.createElement("button"), video = table.dataset.video;
  button.type = "button";
  button.textContent = "CSV";
  button.setAttribute("aria-label", `numbers of ${video} as CSV`);
  const rows = () => [...table.querySelectorAll("[data-number]")].map(({ dataset: d }) =>
    [d.number, d.value, d.sd, d.low95, d.high95, d.unit, d.identified]);
  const head = ["parameter", "value", "sd", "low95", "high95", "unit", "identified"];
  button.addEventListener("click", () => save(`${video}.csv`, "text/csv", csv([head, ...rows()])));
  table.append(button);
}
