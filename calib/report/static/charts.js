// Legs, estimates over the number of stops, held-out stops, projection uncertainty.
(function () {
  // Bars or points by number, in panels one below the other that share their names.
  function strips(where, names, panels, out) {
    const W = Math.max(320, where.clientWidth || 1100), left = 52, right = 12, high = 118, top = 26, bottom = 24;
    where.replaceChildren();
    const svg = chart(where, W, panels.length * high + bottom);
    const wide = (W - left - right) / names.length;
    panels.forEach((panel, p) => {
      const inliers = panel.values.filter((_, i) => !out[i]).map(Math.abs);
      const spread = panel.sigma ? panel.sigma.filter((_, i) => !out[i]).map((s) => 2 * (s || 0)) : [];
      const limit = Math.max(quantile(inliers, 1), quantile(spread, 1), 1e-9) * 1.12;
      const y0 = p * high + top + (high - top) / 2, scale = (high - top) / 2 / limit;
      node(svg, "text", { x: left, y: p * high + 16, class: "title" }, panel.title);
      const t = ticks(-limit, limit, 4);
      t.at.forEach((v) => {
        node(svg, "path", { d: `M${left} ${y0 - v * scale}H${W - right}`, class: Math.abs(v) < t.step / 2 ? "zero" : "hair" });
        node(svg, "text", { x: left - 8, y: y0 - v * scale + 4, "text-anchor": "end" }, tickText(v, t.step));
      });
      panel.values.forEach((v, i) => {
        const x = left + (i + 0.5) * wide, over = Math.abs(v) > limit;
        const y = y0 - Math.max(-limit, Math.min(limit, v)) * scale;
        if (panel.sigma) {
          const s = Math.min(2 * (panel.sigma[i] || 0), limit) * scale;
          node(svg, "path", { d: `M${x} ${y0 - s}V${y0 + s}`, class: "whisker" });
          node(svg, "circle", { cx: x, cy: y, r: 3.6, class: out[i] ? "bar out" : "point" });
        } else {
          const w = Math.min(wide * 0.6, 26);
          node(svg, "rect", { x: x - w / 2, y: Math.min(y, y0), width: w, height: Math.max(Math.abs(y - y0), 0.8), rx: 1.5, class: out[i] ? "bar out" : "bar" });
        }
        if (over) node(svg, "text", { x, y: v > 0 ? y + 12 : y - 4, "text-anchor": "middle", class: "over" }, (v > 0 ? "\u2191" : "\u2193") + Math.abs(v).toPrecision(2));
        else if (out[i]) node(svg, "text", { x, y: v > 0 ? y - 4 : y + 12, "text-anchor": "middle", class: "out-text" }, "out");
      });
    });
    const every = Math.ceil(34 / wide);
    names.forEach((name, i) => {
      if (i % every && !out[i]) return;
      node(svg, "text", { x: left + (i + 0.5) * wide, y: panels.length * high + 16, "text-anchor": "middle", class: out[i] ? "out-text" : "" }, name);
    });
  }

  // Drawn anew whenever the place for it becomes wider or narrower, so that its text keeps its size.
  function fitted(where, draw) {
    let last = 0;
    function fit() {
      if (where.clientWidth === last) return;
      last = where.clientWidth;
      draw();
    }
    // In the next frame: drawing changes heights, which must not happen while sizes are being told.
    new ResizeObserver(() => requestAnimationFrame(fit)).observe(where);
    fit();
  }

  const bars = document.getElementById("leg-bars");
  if (bars) {
    const L = DATA.legs;
    fitted(bars, () => strips(bars, L.names, [
      { title: "Forward, mm", values: L.forward }, { title: "To the left, mm", values: L.left }, { title: "Turn, degrees", values: L.turn },
    ], L.used.map((u) => !u)));
  }

  const held = document.getElementById("heldout-chart");
  if (held) {
    const h = DATA.heldOut;
    fitted(held, () => strips(held, h.stops.map(String), ["Forward, mm", "To the left, mm", "Heading, degrees"].map((title, k) => ({
      title, values: h.error[k].map((v) => v || 0), sigma: h.sigma[k],
    })), h.faulty));
  }

  const growth = document.getElementById("growth-charts");
  if (growth) {
    const G = DATA.growth, n = G.stops, W = 360, H = 172, left = 54, right = 12, top = 30, bottom = 24;
    for (const panel of G.panels) {
      const svg = chart(growth, W, H), last = n.length - 1;
      const value = panel.value, sigma = panel.sigma.map((s) => (s === null ? 1e9 : s));
      const shown = value.map((v, i) => [v, sigma[i]]).filter((p, i) => p[0] !== null && i >= Math.floor(n.length * 0.3));
      if (!shown.length) continue;
      const final = value[last];
      const span = Math.max(...shown.map(([v, s]) => Math.abs(v - final) + 2 * Math.min(s, 8 * sigma[last] + 1e-12)), 1e-9) * 1.08;
      const x = (k) => left + ((n[k] - n[0]) / Math.max(n[last] - n[0], 1)) * (W - left - right);
      const middle = (top + H - bottom) / 2, scale = (H - top - bottom) / 2 / span;
      const y = (v) => Math.max(top, Math.min(H - bottom, middle - (v - final) * scale)).toFixed(1);
      node(svg, "text", { x: 12, y: 18, class: "title" }, `${panel.key}  ${panel.name}, ${panel.unit}`);
      const t = ticks(final - span, final + span, 4);
      t.at.forEach((v) => {
        node(svg, "path", { d: `M${left} ${y(v)}H${W - right}`, class: "hair" });
        node(svg, "text", { x: left - 6, y: Number(y(v)) + 4, "text-anchor": "end" }, tickText(v, t.step));
      });
      ticks(n[0], n[last], 6).at.filter((v) => Number.isInteger(v)).forEach((v) => {
        const at = left + ((v - n[0]) / Math.max(n[last] - n[0], 1)) * (W - left - right);
        node(svg, "text", { x: at, y: H - 8, "text-anchor": "middle" }, String(v));
      });
      [2, 1].forEach((m) => {
        const upper = value.map((v, k) => `${x(k).toFixed(1)} ${y(v + m * sigma[k])}`);
        const lower = value.map((v, k) => `${x(k).toFixed(1)} ${y(v - m * sigma[k])}`).reverse();
        node(svg, "path", { d: `M${upper.join("L")}L${lower.join("L")}Z`, class: m === 2 ? "band2" : "band" });
      });
      node(svg, "path", { d: `M${left} ${y(final)}H${W - right}`, class: "final" });
      node(svg, "path", { d: "M" + value.map((v, k) => `${x(k).toFixed(1)} ${y(v)}`).join("L"), class: "curve" });
      value.forEach((v, k) => node(svg, "circle", { cx: x(k), cy: y(v), r: 2.2, class: "point" }));
    }
  }

  const map = document.getElementById("projection-map");
  if (map) {
    const P = DATA.projection, [W, H] = P.size, unit = W / 640;
    // From light to dark on paper; text keeps its own outline.
    const RAMP = [[238, 245, 247], [158, 202, 214], [66, 146, 172], [16, 91, 121], [8, 48, 76]];
    function colour(share) {
      const s = Math.max(0, Math.min(1, share)) * (RAMP.length - 1), i = Math.min(RAMP.length - 2, Math.floor(s)), f = s - i;
      return `rgb(${RAMP[i].map((v, c) => Math.round(v + f * (RAMP[i + 1][c] - v))).join(",")})`;
    }
    const all = P.maps.flatMap((m) => m.sigma.filter((s) => s !== null));
    const low = Math.min(...all), high = Math.max(...all);
    const share = (s) => (high > low ? Math.log(s / low) / Math.log(high / low) : 0.5);
    let seen = "";
    for (const s of DATA.residuals.stops) for (let i = 0; i < s.u.length; i += 3) seen += `M${s.u[i]} ${s.v[i]}h0`;
    function draw() {
      const checked = document.querySelector("input[name=distance]:checked");
      const m = P.maps[checked ? Number(checked.value) : 0];
      map.replaceChildren();
      const pad = 8 * unit, foot = 46 * unit;
      const svg = node(map, "svg", { viewBox: `${-0.5 - pad} ${-0.5 - pad} ${W + 2 * pad} ${H + 2 * pad + foot}`, "aria-hidden": "true", focusable: "false" });
      const w = W / P.columns, h = H / P.rows;
      m.sigma.forEach((s, i) => {
        if (s === null) return;
        const c = i % P.columns, r = Math.floor(i / P.columns);
        node(svg, "rect", { x: c * w - 0.5, y: r * h - 0.5, width: w + 0.3, height: h + 0.3, fill: colour(share(s)) });
      });
      node(svg, "path", { d: seen, class: "seen", "stroke-width": 2 * unit });
      for (let r = 0; r < 5; r++) for (let c = 0; c < 7; c++) {
        const i = Math.min(P.rows - 1, Math.round((r + 0.5) * P.rows / 5 - 0.5)) * P.columns + Math.min(P.columns - 1, Math.round((c + 0.5) * P.columns / 7 - 0.5));
        const s = m.sigma[i];
        if (s === null) continue;
        const at = node(svg, "text", { x: ((i % P.columns) + 0.5) * w, y: (Math.floor(i / P.columns) + 0.5) * h + 4 * unit, "text-anchor": "middle", class: "over" }, s.toPrecision(2));
        at.setAttribute("font-size", 12 * unit);
      }
      const bar = { x: 0, y: H + 12 * unit, width: W * 0.5 };
      for (let k = 0; k < 60; k++) node(svg, "rect", { x: (k / 60) * bar.width, y: bar.y, width: bar.width / 60 + 0.5, height: 9 * unit, fill: colour(k / 59) });
      node(svg, "text", { x: 0, y: bar.y + 24 * unit }, `${low.toPrecision(2)} px`);
      node(svg, "text", { x: bar.width, y: bar.y + 24 * unit, "text-anchor": "end" }, `${high.toPrecision(2)} px`);
    }
    document.querySelectorAll("input[name=distance]").forEach((i) => i.addEventListener("change", draw));
    draw();
  }
})();
