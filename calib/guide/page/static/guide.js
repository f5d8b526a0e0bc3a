"use strict";
const $ = (id) => document.getElementById(id);
const text = (id, value) => { const node = $(id); if (node.textContent !== value) node.textContent = value; };
const SIGNS = {
  go: '<path d="M22 42 L42 22 M28 22 L42 22 L42 36"/>',
  hold: '<rect class="still" x="23" y="21" width="6" height="22" rx="2"/><rect class="still" x="35" y="21" width="6" height="22" rx="2"/>',
  taken: '<path d="M21 33 L29 41 L44 24"/>', done: '<path d="M21 33 L29 41 L44 24"/>',
  bad: '<path d="M32 19 L32 35 M32 44 L32 44.5"/>', care: '<path d="M32 19 L32 35 M32 44 L32 44.5"/>', wait: '<path d="M32 22 L32 33 L40 38"/>',
};
let state = null, shown = 0, loading = false, heard = performance.now();

function banner(now) {
  const node = $("banner");
  if (node.dataset.kind !== now.kind || !$("sign").innerHTML) { node.dataset.kind = now.kind; $("sign").innerHTML = SIGNS[now.kind]; }
  text("title", now.title); text("detail", now.detail);
  $("arc").style.strokeDashoffset = 169.6 * (1 - (now.kind === "taken" || now.kind === "done" ? 1 : now.progress));
}

function list(node, items, one) {
  const key = JSON.stringify(items);
  if (node.dataset.key === key) return;
  node.dataset.key = key;
  node.replaceChildren(...items.map(one));
}

function element(name, className, content) {
  const node = document.createElement(name);
  if (className) node.className = className;
  if (content !== undefined) node.textContent = content;
  return node;
}

function camera(picture) {
  const none = !picture.number;
  $("no-picture").hidden = !none;
  $("frame").classList.toggle("old", !none && picture.old);
  if (none) return;
  text("seen", picture.old ? "picture is old" : picture.seen);
  const sharp = $("sharp");
  text("sharp", picture.sharp ? `${picture.sharp} (edges ${picture.edge_px} px)` : "");
  sharp.className = "sharp " + (picture.sharp === "sharp" ? "sharp-good" : "sharp-soft");
  if (picture.number === shown || loading) return;
  loading = true;
  const image = $("picture"), number = picture.number;
  image.onload = image.onerror = () => { loading = false; };
  image.onload = () => {
    loading = false; image.hidden = false;
    $("frame").style.aspectRatio = `${picture.width} / ${picture.height}`;
    const tags = $("tags");
    tags.setAttribute("viewBox", "0 0 1 1"); tags.setAttribute("preserveAspectRatio", "none");
    tags.classList.toggle("soft", picture.sharp !== "sharp");
    tags.replaceChildren(...picture.tags.map((c) => Plan.make("polygon", { points: `${c[0]},${c[1]} ${c[2]},${c[3]} ${c[4]},${c[5]} ${c[6]},${c[7]}` })));
  };
  shown = number;
  image.src = `picture.jpg?${number}`;
}

function cameras(now) {
  const node = $("cameras");
  node.hidden = now.all.length < (now.chosen ? 2 : 1);
  node.classList.toggle("open", !now.chosen);
  if (document.activeElement === node && node.dataset.all === JSON.stringify(now.all)) return;
  node.dataset.all = JSON.stringify(now.all);
  list(node, now.chosen ? now.all : ["", ...now.all], (topic) => { const item = element("option", "", topic || "choose a camera"); item.value = topic; return item; });
  node.value = now.chosen;
}

function next(places) {
  $("next").hidden = !places.length;
  if (!places.length) return;
  list($("steps"), places[0].steps, (step) => element("li", "", step));
  text("place", `next stop: ${places[0].text}`);
  text("gain", places[0].gain);
  const node = $("place");
  node.dataset.x = places[0].x; node.dataset.y = places[0].y; node.dataset.heading = places[0].heading; node.dataset.turns = places[0].whole_turns;
}

function bar(now) {
  const row = element("div", "row" + (now.reached ? " reached" : "")), value = element("dd", "", now.value + " ");
  value.append(element("small", "", `of ${now.goal}`));
  const track = element("div", "track"), fill = element("div", "fill");
  fill.style.width = `${100 * now.share}%`;
  track.append(fill);
  row.append(element("dt", "", now.label), value, track);
  return row;
}

function end(now) {
  const done = now.finished;
  $("result").hidden = !done.level;
  if (done.level) {
    $("verdict").className = "verdict " + done.level;
    text("verdict", `${done.level.toUpperCase()}: ${done.headline}`);
    list($("why"), done.lines.filter(([label]) => label !== "hence").slice(0, 6), ([label, line]) => element("li", "", label === "do" ? line : `${label}: ${line}`));
  }
  const checked = now.verdict.checked || [];
  $("checked-card").hidden = !checked.length;
  list($("checked"), checked, ([word, topic, line]) => { const item = element("li", word); item.append(element("b", "", word), element("span", "topic", topic), element("span", "", line)); return item; });
  const judged = !now.verdict.level ? "" : now.verdict.level === "good" ? `good after ${now.verdict.stops} stops` : `not good yet after ${now.verdict.stops} stops`;
  text("judged", now.calibrating ? "calibrating ..." : done.level ? "" : judged);
  const button = $("calibrate");
  button.disabled = !now.can_calibrate || now.calibrating;
  button.classList.toggle("enough", now.enough && !done.level);
  text("calibrate", now.enough && !done.level ? "Enough: calibrate" : done.level ? "Calibrate again" : "Calibrate now");
}

function show(now) {
  state = now;
  document.title = `${now.banner.title} - boxcal guide`;
  text("robot", now.robot);
  $("link").classList.toggle("on", now.connected);
  text("link-text", now.source);
  banner(now.banner);
  text("stops", String(now.stops)); text("stops-word", now.stops === 1 ? "stop" : "stops");
  list($("warnings"), now.warnings, (w) => { const item = element("li", w.level); item.append(element("span", "", w.text)); return item; });
  camera(now.picture);
  cameras(now.cameras);
  Plan.draw($("plan"), now.plan);
  next(now.plan.next);
  list($("bars"), now.bars, bar);
  text("bars-note", now.bars_note);
  end(now);
  const r = now.recording;
  const drops = r.dropped ? `, ${r.dropped} pictures more than needed left out` : "";
  text("recording", r.file ? `recording ${r.file}: ${r.size}, ${r.messages} messages${drops}${r.lost ? `, ${r.lost} lost` : ""}` : "nothing recorded yet");
  document.body.dataset.stops = now.stops; document.body.dataset.enough = now.enough; document.body.dataset.finished = now.finished.level || "";
}

function ask(what) { return fetch(`ask/${what}`, { method: "POST", headers: { "X-Boxcal": "page" } }); }

function connect() {
  const stream = new EventSource("events");
  stream.onmessage = (event) => { heard = performance.now(); document.body.classList.remove("gone"); show(JSON.parse(event.data)); };
  stream.onopen = () => { heard = performance.now(); };
  stream.onerror = () => {
    document.body.classList.add("gone");
    banner({ kind: "bad", title: "The guide does not answer", detail: "is it still running? This page goes on as soon as it is back", progress: 0 });
    if (stream.readyState === EventSource.CLOSED) { stream.close(); setTimeout(connect, 2000); }
  };
}

$("calibrate").addEventListener("click", () => ask("calibrate"));
$("again").addEventListener("click", () => { if (!state || !state.stops || confirm("Begin a new drive? What was recorded is kept.")) ask("again"); });
$("cameras").addEventListener("change", (event) => {
  const topic = event.target.value;
  event.target.blur();
  if (topic && (!state.stops || confirm("Begin a new drive with this camera? What was recorded is kept."))) ask(`camera?topic=${encodeURIComponent(topic)}`);
});
addEventListener("resize", () => { if (state) Plan.draw($("plan"), state.plan); });
connect();
