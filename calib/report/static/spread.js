// One strip of points a parameter: named robots of a small fleet, a cloud of a large one.
(function () {
  const where = document.getElementById("spread-charts");
  if (!where) return;
  // So many robots get a line each with their name; of more only those that are far from the others are named, and of
  // very many all others are one path.
  const NAMED = 16, SINGLE = 150;
  const short = (name) => (name.length > 16 ? name.slice(0, 15) + "\u2026" : name);

  function strip(panel) {
    const n = panel.value.length, named = n <= NAMED, odd = new Set(panel.odd);
    const longest = named ? Math.min(16, Math.max(...DATA.robots.map((r) => r.length))) : 0;
    const W = 360, left = 16 + 6.6 * longest, right = 16, top = 32, base = named ? top + 15 * n : 84, H = base + 28;
    const svg = chart(where, W, H);
    node(svg, "text", { x: 12, y: 18, class: "title" }, `${panel.name}${panel.unit ? ", " + panel.unit : ""}`);
    const known = panel.value.filter((v) => v !== null);
    // Robots that are hardly known must not squeeze all others together.
    let low = known.reduce((a, b) => Math.min(a, b), Infinity), high = known.reduce((a, b) => Math.max(a, b), -Infinity);
    const typical = quantile(panel.sigma.map((s) => s || 0), 0.5);
    low -= 2 * typical + 0.04 * (high - low) + 1e-9;
    high += 2 * typical + 0.04 * (high - low) + 1e-9;
    const x = (v) => (left + ((Math.max(low, Math.min(high, v)) - low) / (high - low)) * (W - left - right)).toFixed(1);
    let t = ticks(low, high, 5);
    const crowded = () => (t.step / (high - low)) * (W - left - right) < 6.6 * tickText(high, t.step).length + 6;
    for (let parts = 4; parts > 0 && crowded(); parts--) t = ticks(low, high, parts);
    t.at.forEach((v) => {
      node(svg, "path", { d: `M${x(v)} ${top - 4}V${base}`, class: "hair" });
      node(svg, "text", { x: x(v), y: base + 16, "text-anchor": "middle" }, tickText(v, t.step));
    });
    if (n > 2) node(svg, "path", { d: `M${x(quantile(panel.value, 0.5))} ${top - 4}V${base}`, class: "final" });
    const place = (i) => (named ? top + 15 * i + 4 : top + ((i * 0.618034) % 1) * (base - top - 4));
    if (n > SINGLE) {
      const points = panel.value.map((v, i) => (v === null || odd.has(i) ? "" : `M${x(v)} ${place(i).toFixed(1)}h0`)).join("");
      node(svg, "path", { d: points, class: "cloud" });
      const middle = quantile(panel.value, 0.5);
      node(svg, "path", { d: `M${x(middle - 2 * typical)} ${top - 4}H${x(middle + 2 * typical)}`, class: "whisker" });
    }
    const step = Math.min(9, (base - top) / Math.max(n, 1));
    (n > SINGLE ? panel.odd : panel.value.map((_, i) => i)).forEach((i) => {
      const v = panel.value[i], y = place(i), out = odd.has(i), s = 2 * (panel.sigma[i] || 0);
      if (v === null) return;
      if (named) node(svg, "text", { x: left - 12, y: y + 4, "text-anchor": "end", class: out ? "out-text" : "" }, short(DATA.robots[i]));
      if (n <= SINGLE) node(svg, "path", { d: `M${x(v - s)} ${y.toFixed(1)}H${x(v + s)}`, class: "whisker", "stroke-width": Math.max(2, step / 2) });
      const dot = node(svg, "circle", { cx: x(v), cy: y.toFixed(1), r: out ? 4.4 : 3, class: out ? "bar out" : "point" });
      node(dot, "title", {}, `${DATA.robots[i]}: ${v}`);
      if (out && !named && n <= SINGLE) node(svg, "text", { x: x(v), y: y - 7, "text-anchor": Number(x(v)) > W / 2 ? "end" : "start", class: "out-text" }, short(DATA.robots[i]));
    });
  }

  const waiting = [...DATA.panels];
  function drawAll() { while (waiting.length) strip(waiting.shift()); }
  if (DATA.robots.length <= SINGLE) return drawAll();
  // Of very many robots a strip a frame, so that the page answers meanwhile; all at once for the printer.
  window.addEventListener("beforeprint", drawAll);
  (function next() {
    if (!waiting.length) return;
    strip(waiting.shift());
    setTimeout(next, 0);
  })();
})();
