// Any two figures of all robots against each other, a colour a hardware revision; those that the filter leaves are strong.
(function () {
  const where = document.getElementById("plot-chart");
  if (!where) return;
  const across = document.getElementById("plot-x"), up = document.getElementById("plot-y"), says = document.getElementById("plot-says");
  const [groups, of] = DATA.rows.hardware, GROUPS = 4;
  const extra = [
    { name: "After 10 m", unit: "m", value: DATA.rows.straight }, { name: "After a turn", unit: "\u00b0", value: DATA.rows.turn },
    { name: "Corners", unit: "px", value: DATA.rows.rms }, { name: "Stops", unit: "", value: DATA.rows.stops },
  ];
  const figures = [...DATA.panels, ...extra, ...DATA.panels.map((p) => ({ name: `Sigma of ${p.name.charAt(0).toLowerCase()}${p.name.slice(1)}`, unit: p.unit, value: p.sigma }))];
  for (const select of [across, up]) figures.forEach((f, k) => select.add(new Option(f.name, k)));
  across.value = 1;
  up.value = 0;
  const title = (f) => `${f.name}${f.unit ? ", " + f.unit : ""}`;
  let kept = DATA.robots.map((_, i) => i), points = [];

  function range(values) {
    const known = values.filter((v) => v !== null).sort((a, b) => a - b), n = known.length;
    if (!n) return [0, 1];
    // One wild robot must not squeeze all others together: it is drawn at the edge.
    const q = (f) => known[Math.min(n - 1, Math.floor(f * n))];
    const wide = 3 * (q(0.99) - q(0.01)) + 1e-9 * Math.abs(q(0.5)) + 1e-12;
    const low = Math.max(known[0], q(0.01) - wide), high = Math.min(known[n - 1], q(0.99) + wide), rim = 0.05 * (high - low) || 0.01 * Math.abs(high) || 1;
    return [low - rim, high + rim];
  }

  function draw() {
    const X = figures[across.value], Y = figures[up.value];
    const W = Math.max(320, where.clientWidth || 900), H = Math.min(460, Math.max(300, W * 0.55)), left = 64, right = 16, top = 30, bottom = 44;
    where.replaceChildren();
    const svg = chart(where, W, H);
    svg.setAttribute("height", H);
    const [x0, x1] = range(X.value), [y0, y1] = range(Y.value);
    const clamp = (v, a, b) => Math.max(a, Math.min(b, v));
    const px = (v) => left + ((clamp(v, x0, x1) - x0) / (x1 - x0)) * (W - left - right);
    const py = (v) => H - bottom - ((clamp(v, y0, y1) - y0) / (y1 - y0)) * (H - top - bottom);
    const tx = ticks(x0, x1, W / 110), ty = ticks(y0, y1, 6);
    for (const v of tx.at) {
      node(svg, "path", { d: `M${px(v).toFixed(1)} ${top}V${H - bottom}`, class: "hair" });
      node(svg, "text", { x: px(v), y: H - bottom + 16, "text-anchor": "middle" }, tickText(v, tx.step));
    }
    for (const v of ty.at) {
      node(svg, "path", { d: `M${left} ${py(v).toFixed(1)}H${W - right}`, class: "hair" });
      node(svg, "text", { x: left - 8, y: py(v) + 4, "text-anchor": "end" }, tickText(v, ty.step));
    }
    node(svg, "text", { x: left, y: 16, class: "title" }, title(Y));
    node(svg, "text", { x: W - right, y: H - 8, "text-anchor": "end", class: "title" }, title(X));
    const strong = new Uint8Array(DATA.robots.length);
    for (const i of kept) strong[i] = 1;
    const faint = [], paths = groups.map(() => []);
    points = [];
    for (let i = 0; i < strong.length; i++) {
      const a = X.value[i], b = Y.value[i];
      if (a === null || b === null || a === undefined || b === undefined) continue;
      const x = px(a), y = py(b), d = `M${x.toFixed(1)} ${y.toFixed(1)}h0`;
      if (strong[i]) { paths[of[i]].push(d); points.push([x, y, i]); } else faint.push(d);
    }
    if (faint.length) node(svg, "path", { d: faint.join(""), class: "cloud faint" });
    paths.forEach((p, g) => { if (p.length) node(svg, "path", { d: p.join(""), class: groups.length > 1 ? `cloud face${g % GROUPS}` : "cloud" }); });
    const ring = node(svg, "circle", { r: 7, class: "ring", cx: -20, cy: -20 });
    svg.onpointermove = svg.onpointerdown = (e) => {
      const box = svg.getBoundingClientRect(), x = ((e.clientX - box.left) / box.width) * W, y = ((e.clientY - box.top) / box.height) * H;
      let best = null, least = 400;
      for (const p of points) {
        const d = (p[0] - x) ** 2 + (p[1] - y) ** 2;
        if (d < least) { least = d; best = p; }
      }
      if (!best) return;
      ring.setAttribute("cx", best[0]);
      ring.setAttribute("cy", best[1]);
      const i = best[2];
      says.textContent = `${DATA.robots[i]}${groups[of[i]] ? ` (${groups[of[i]]})` : ""}: ${title(X)} ${Number(X.value[i].toPrecision(6))}; ${title(Y)} ${Number(Y.value[i].toPrecision(6))}`;
    };
  }
  const legend = document.getElementById("plot-legend");
  if (legend) groups.forEach((g, k) => {
    const item = document.createElement("li"), swatch = document.createElement("span");
    swatch.className = `swatch face${k % GROUPS}`;
    item.append(swatch, g || "not told");
    legend.append(item);
  });
  let wide = 0;
  new ResizeObserver(() => requestAnimationFrame(() => {
    if (where.clientWidth === wide) return;
    wide = where.clientWidth;
    draw();
  })).observe(where);
  across.addEventListener("change", draw);
  up.addEventListener("change", draw);
  let due = 0;
  window.plotRobots = (now) => {
    kept = now;
    cancelAnimationFrame(due);
    due = requestAnimationFrame(draw);
  };
  document.getElementById("plot-form").addEventListener("submit", (e) => e.preventDefault());
})();
