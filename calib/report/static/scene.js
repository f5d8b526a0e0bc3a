// The 3-D view: everything is a polygon or a line in frame box, drawn from far to near.
(function () {
  const canvas = document.getElementById("scene");
  if (!canvas || !DATA.scene.stops.length) return;
  const context = canvas.getContext("2d");
  const S = DATA.scene;
  let reach = 0.4;
  for (const s of S.stops) reach = Math.max(reach, Math.hypot(s.cam[0], s.cam[1]));
  for (const leg of S.legs) for (let i = 0; i < leg.path.length; i += 2) reach = Math.max(reach, Math.hypot(leg.path[i], leg.path[i + 1]));
  const HOME = { azimuth: -0.9, elevation: 0.62, zoom: 1 };
  let view = { ...HOME };
  let chosen = "";
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const printing = window.matchMedia("print");

  function colours() {
    const style = getComputedStyle(document.documentElement);
    const c = (name) => style.getPropertyValue("--" + name).trim();
    return { panel: c("panel"), ink: c("ink"), soft: c("soft"), line: c("line"), hair: c("hair"), accent: c("accent"), redo: c("redo"), usable: c("usable"), face: [0, 1, 2, 3].map((f) => c("face" + f)) };
  }

  function camera() {
    const ca = Math.cos(view.azimuth), sa = Math.sin(view.azimuth);
    const ce = Math.cos(view.elevation), se = Math.sin(view.elevation);
    // Rows: right, up, towards the viewer.
    return { right: [-sa, ca, 0], up: [-se * ca, -se * sa, ce], near: [ce * ca, ce * sa, se] };
  }

  function draw() {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width) return;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const k = colours(), cam = camera();
    const distance = 4.5 * reach / view.zoom;
    const focal = Math.min(width, height * 1.55) * 1.66;
    const dot = (a, p) => a[0] * p[0] + a[1] * p[1] + a[2] * p[2];
    const centre = [0, 0, S.box[2] / 3];
    const items = [];

    function see(p) {
      const q = [p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]];
      const depth = distance - dot(cam.near, q);
      const f = focal / Math.max(depth, 0.02);
      return [width / 2 + f * dot(cam.right, q), height / 2 - f * dot(cam.up, q), depth];
    }
    function add(points, look, shift) {
      const seen = points.map(see);
      if (seen.some((p) => p[2] < 0.05)) return;
      items.push({ seen, look, depth: seen.reduce((s, p) => s + p[2], 0) / seen.length - (shift || 0) });
    }
    function paint(items) {
      items.sort((a, b) => b.depth - a.depth);
      for (const { seen, look } of items) {
        if (look.text) {
          context.font = (look.bold ? "600 " : "") + "12px system-ui, sans-serif";
          context.textAlign = "center";
          context.lineWidth = 3;
          context.lineJoin = "round";
          context.strokeStyle = k.panel;
          context.strokeText(look.text, seen[0][0], seen[0][1]);
          context.fillStyle = look.fill;
          context.fillText(look.text, seen[0][0], seen[0][1]);
          continue;
        }
        context.beginPath();
        seen.forEach((p, i) => (i ? context.lineTo(p[0], p[1]) : context.moveTo(p[0], p[1])));
        if (look.closed) context.closePath();
        context.globalAlpha = look.alpha || 1;
        if (look.fill) { context.fillStyle = look.fill; context.fill(); }
        context.globalAlpha = look.lineAlpha || 1;
        if (look.stroke) {
          context.strokeStyle = look.stroke;
          context.lineWidth = look.width || 1;
          context.lineJoin = context.lineCap = "round";
          context.setLineDash(look.dash || []);
          context.stroke();
          context.setLineDash([]);
        }
        context.globalAlpha = 1;
      }
    }

    // Floor and path lie under everything else when seen from above.
    const half = Math.ceil((reach + 0.2) * 4) / 4;
    for (let g = -half; g <= half + 1e-9; g += 0.25) {
      add([[g, -half, 0], [g, half, 0]], { stroke: k.hair });
      add([[-half, g, 0], [half, g, 0]], { stroke: k.hair });
    }
    paint(items.splice(0));
    for (const leg of S.legs) {
      const points = [];
      for (let i = 0; i < leg.path.length; i += 2) points.push([leg.path[i], leg.path[i + 1], 0]);
      const look = leg.used ? { stroke: k.accent, width: 1.6, lineAlpha: 0.75 } : { stroke: k.redo, width: 2.4, dash: [6, 5] };
      add(points, look);
      if (!leg.used) {
        const middle = points[Math.floor(points.length / 2)];
        add([[middle[0], middle[1], 0.02]], { text: leg.name, fill: k.redo, bold: true });
      }
    }
    for (const stop of S.stops) {
      const [x, y, a] = stop.body, r = S.robot[0] / 2;
      const on = !chosen || chosen === stop.stop;
      const at = (f, l) => [x + Math.cos(a) * f - Math.sin(a) * l, y + Math.sin(a) * f + Math.cos(a) * l, 0];
      add([at(1.3 * r, 0), at(-0.6 * r, r), at(-0.6 * r, -r)], { closed: true, fill: k.ink, alpha: on ? 0.22 : 0.08, stroke: k.ink, lineAlpha: on ? 0.7 : 0.25 });
    }
    paint(items.splice(0));

    const tall = 0.08;
    add([[0, 0, S.box[2]], [S.box[0] / 2 + 0.12, 0, S.box[2]]], { stroke: "#d04437", width: 2 });
    add([[0, 0, S.box[2]], [0, S.box[1] / 2 + 0.12, S.box[2]]], { stroke: "#3a9b4f", width: 2 });
    add([[0, 0, S.box[2]], [0, 0, S.box[2] + tall + 0.06]], { stroke: "#3b7ddd", width: 2 });
    const [w, d, h] = S.box.map((v, i) => (i < 2 ? v / 2 : v));
    const eye = [0, 1, 2].map((i) => centre[i] + cam.near[i] * distance);
    const corners = [[w, -d], [w, d], [-w, d], [-w, -d]];
    S.faces.forEach((n, f) => {
      const [a, b] = [corners[f], corners[(f + 1) % 4]];
      const facing = (eye[0] - a[0]) * n[0] + (eye[1] - a[1]) * n[1] > 0;
      add([[a[0], a[1], 0], [b[0], b[1], 0], [b[0], b[1], h], [a[0], a[1], h]], { closed: true, fill: "#fdfdfb", stroke: k.soft }, facing ? 0.01 : 0);
      if (!facing) return;
      add([[n[0] * w * 1.02, n[1] * d * 1.02, h + 0.035]], { text: "face " + f, fill: k.face[f], bold: true }, 0.2);
    });
    add(corners.map((p) => [p[0], p[1], h]), { closed: true, fill: "#eceeeb", stroke: k.soft }, cam.near[2] > 0 ? 0.005 : -0.005);
    for (const [t, f] of S.tags) {
      const n = S.faces[f];
      if ((eye[0] - t[0]) * n[0] + (eye[1] - t[1]) * n[1] <= 0) continue;
      add([[t[0], t[1], t[2]], [t[3], t[4], t[5]], [t[6], t[7], t[8]], [t[9], t[10], t[11]]], { closed: true, fill: k.face[f], alpha: 0.75 }, 0.2);
    }
    for (const stop of S.stops) {
      const on = !chosen || chosen === stop.stop;
      const c = stop.cam, v = [0, 1, 2, 3].map((i) => stop.view.slice(3 * i, 3 * i + 3));
      const look = { closed: true, stroke: on ? k.ink : k.soft, lineAlpha: on ? 0.8 : 0.25, fill: k.accent, alpha: chosen === stop.stop ? 0.3 : on ? 0.08 : 0.02 };
      for (let i = 0; i < 4; i++) add([c, v[i], v[(i + 1) % 4]], look);
      add([v[0], v[1]], { stroke: on ? k.accent : k.soft, width: 2.2, lineAlpha: on ? 1 : 0.3 });
      add([c, [c[0], c[1], 0]], { stroke: k.soft, lineAlpha: on ? 0.5 : 0.15, dash: [2, 3] });
      add([[c[0], c[1], c[2] + 0.045]], { text: stop.stop, fill: on ? k.ink : k.soft, bold: chosen === stop.stop }, 0.1);
    }
    paint(items);
  }

  function turn(azimuth, elevation) {
    view.azimuth += azimuth;
    view.elevation = Math.min(1.57, Math.max(-0.1, view.elevation + elevation));
    draw();
  }
  function zoom(factor) {
    view.zoom = Math.min(6, Math.max(0.4, view.zoom * factor));
    draw();
  }
  const ACTIONS = {
    left: () => turn(-0.2, 0), right: () => turn(0.2, 0), up: () => turn(0, 0.15), down: () => turn(0, -0.15),
    in: () => zoom(1.2), out: () => zoom(1 / 1.2),
    top: () => { view = { ...view, azimuth: -Math.PI / 2, elevation: 1.57 }; draw(); },
    reset: () => { view = { ...HOME }; draw(); },
  };
  const KEYS = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down", "+": "in", "=": "in", "-": "out", Home: "reset" };
  document.querySelectorAll("[data-view]").forEach((b) => b.addEventListener("click", () => ACTIONS[b.dataset.view]()));
  canvas.addEventListener("keydown", (e) => {
    if (!KEYS[e.key] || e.ctrlKey || e.metaKey || e.altKey) return;
    e.preventDefault();
    ACTIONS[KEYS[e.key]]();
  });
  const fingers = new Map();
  let spread = 0;
  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId);
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    spread = 0;
  });
  canvas.addEventListener("pointermove", (e) => {
    const last = fingers.get(e.pointerId);
    if (!last) return;
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    if (fingers.size === 1) turn(-(e.clientX - last[0]) * 0.008, (e.clientY - last[1]) * 0.006);
    else {
      const [a, b] = [...fingers.values()];
      const now = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (spread) zoom(now / spread);
      spread = now;
    }
  });
  ["pointerup", "pointercancel"].forEach((kind) => canvas.addEventListener(kind, (e) => { fingers.delete(e.pointerId); spread = 0; }));
  canvas.addEventListener("wheel", (e) => {
    if (document.activeElement !== canvas) return;
    e.preventDefault();
    zoom(Math.exp(-e.deltaY * 0.0012));
  }, { passive: false });
  document.addEventListener("stopchosen", (e) => { chosen = e.detail; draw(); });
  dark.addEventListener("change", draw);
  printing.addEventListener("change", draw);
  window.addEventListener("beforeprint", draw);
  window.addEventListener("resize", draw);
  draw();
})();
