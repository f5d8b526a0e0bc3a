"use strict";
const $ = (id) => document.getElementById(id);
const V = 0.22, W = 0.9;
let state = null, held = { v: 0, w: 0 }, sent = false;
const keys = new Set();
const KEYS = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1], w: [1, 0], s: [-1, 0], a: [0, 1], d: [0, -1] };

async function post(path, content) {
  const answer = await fetch(path, { method: "POST", headers: { "X-Boxcal": "page", "Content-Type": "application/json" }, body: JSON.stringify(content) });
  $("said").textContent = answer.ok ? "" : answer.status === 409 ? (await answer.json()).said : "that was not understood";
}

function hold() {
  let v = held.v, w = held.w;
  for (const key of keys) { v += KEYS[key][0]; w += KEYS[key][1]; }
  const wanted = v || w;
  if (wanted || sent) post("drive", { v: V * Math.sign(v), w: W * Math.sign(w) });
  sent = Boolean(wanted);
}
setInterval(hold, 150);

for (const button of $("pad").querySelectorAll("button")) {
  const on = (event) => { event.preventDefault(); held = { v: Number(button.dataset.v), w: Number(button.dataset.w) }; sent = true; button.classList.add("on"); hold(); };
  const off = () => { held = { v: 0, w: 0 }; button.classList.remove("on"); };
  button.addEventListener("pointerdown", on);
  for (const name of ["pointerup", "pointerleave", "pointercancel"]) button.addEventListener(name, off);
}
addEventListener("keydown", (event) => { if (event.key in KEYS && event.target.tagName !== "INPUT") { keys.add(event.key); event.preventDefault(); hold(); } });
addEventListener("keyup", (event) => { if (keys.delete(event.key)) hold(); });
addEventListener("blur", () => keys.clear());

$("plan").addEventListener("click", (event) => {
  const svg = $("plan"), at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  post("go", { x: at.x, y: -at.y });
});
$("go").addEventListener("submit", (event) => {
  event.preventDefault();
  const heading = $("heading").value.trim();
  post("go", { x: Number($("x").value), y: Number($("y").value), heading: heading === "" ? null : Number(heading) * Math.PI / 180, whole_turns: Number($("turns").value || 0) });
});
for (const button of document.querySelectorAll(".trouble button")) button.addEventListener("click", () => post("trouble", { kind: button.dataset.kind }));

function draw(now) {
  const next = now.ahead.length ? [{ ...now.robot, points: now.ahead }] : [];
  Plan.draw($("plan"), { box: now.box, stops: [], robot: now.robot, next, size: now.size });
}

function show(now) {
  state = now;
  $("bridge").textContent = now.bridge;
  document.body.dataset.moving = now.moving;
  draw(now);
  document.querySelector('[data-kind="dark"]').textContent = now.dark ? "Lights on" : "Lights out";
  const frame = $("guide");
  if (now.guide && frame.hidden) { frame.hidden = false; frame.src = now.guide; document.body.classList.add("beside"); }
}
const stream = new EventSource("events");
stream.onmessage = (event) => show(JSON.parse(event.data));
addEventListener("resize", () => { if (state) draw(state); });
