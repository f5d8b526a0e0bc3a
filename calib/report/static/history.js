// A robot's figures over time: drives as dots, levels and trends as lines, changes as dashed lines.
(function () {
  const where = document.getElementById("history-charts"), T = DATA.years, n = T.length;
  const W = 360, H = 150, left = 52, right = 12, top = 30, bottom = 26;
  const first = T[0], span = Math.max(T[n - 1] - first, 1 / 52);
  const x = (t) => (left + 8 + ((t - first) / span) * (W - left - right - 16)).toFixed(1);
  for (const p of DATA.panels) {
    const svg = chart(where, W, H), odd = new Set(p.odd);
    node(svg, "text", { x: 12, y: 18, class: "title" }, `${p.name}${p.unit ? ", " + p.unit : ""}`);
    const known = p.value.map((v, i) => i).filter((i) => p.value[i] !== null);
    if (!known.length) {
      node(svg, "text", { x: left, y: H / 2 }, "not determined");
      continue;
    }
    let low = Infinity, high = -Infinity;
    for (const i of known) {
      const reach = Math.min(2 * p.sigma[i], 2 * quantile(known.map((k) => p.sigma[k]), 0.5) * 1.5);
      low = Math.min(low, p.value[i] - reach);
      high = Math.max(high, p.value[i] + reach);
    }
    const rim = 0.06 * (high - low) || 1e-6;
    low -= rim;
    high += rim;
    const y = (v) => (H - bottom - ((Math.max(low, Math.min(high, v)) - low) / (high - low)) * (H - top - bottom)).toFixed(1);
    const t = ticks(low, high, 4);
    for (const v of t.at) {
      node(svg, "path", { d: `M${left} ${y(v)}H${W - right}`, class: "hair" });
      node(svg, "text", { x: left - 6, y: Number(y(v)) + 4, "text-anchor": "end" }, tickText(v, t.step));
    }
    node(svg, "text", { x: left, y: H - 8 }, DATA.dates[0]);
    if (n > 1) node(svg, "text", { x: W - right, y: H - 8, "text-anchor": "end" }, DATA.dates[n - 1]);
    for (const [x0, y0, x1, y1] of p.lines) {
      const s = 2 * p.scatter;
      if (s > 0) node(svg, "path", { d: `M${x(x0)} ${y(y0 - s)}L${x(x1)} ${y(y1 - s)}V${y(y1 + s)}L${x(x0)} ${y(y0 + s)}Z`, class: "band" });
      node(svg, "path", { d: `M${x(x0)} ${y(y0)}L${x(x1)} ${y(y1)}`, class: "curve" });
    }
    for (const k of p.cuts) node(svg, "path", { d: `M${x((T[k - 1] + T[k]) / 2)} ${top - 4}V${H - bottom}`, class: "final" });
    if (n <= 80) for (const i of known) node(svg, "path", { d: `M${x(T[i])} ${y(p.value[i] - 2 * p.sigma[i])}V${y(p.value[i] + 2 * p.sigma[i])}`, class: "whisker", "stroke-width": 3 });
    for (const i of known) {
      const dot = node(svg, "circle", { cx: x(T[i]), cy: y(p.value[i]), r: n > 80 ? 1.8 : 2.6, class: odd.has(i) ? "bar out" : "point" });
      node(dot, "title", {}, `${DATA.dates[i]}: ${p.value[i]} ± ${p.sigma[i]} ${p.unit}`);
    }
  }
})();
