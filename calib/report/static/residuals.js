// Residuals as vectors over the image and as a cloud, for one stop or all, one face or all.
(function () {
  const field = document.getElementById("residual-field"), cloud = document.getElementById("residual-cloud");
  if (!field) return;
  const R = DATA.residuals, [W, H] = R.size;
  const pick = (id) => document.getElementById(id);
  const used = [];
  for (const s of R.stops) {
    const wrong = new Set(s.wrong);
    s.u.forEach((_, i) => { if (!wrong.has(i)) used.push(Math.hypot(s.du[i], s.dv[i])); });
  }
  const rms = Math.sqrt(used.reduce((a, r) => a + r * r, 0) / Math.max(used.length, 1));
  const sigma = rms / Math.SQRT2;
  const nice = (x) => { const p = Math.pow(10, Math.floor(Math.log10(x))); return [5, 2, 1].map((m) => m * p).find((m) => m <= x) || p; };
  const fit = rms > 0 ? nice((W / 45) / rms) : 1;

  function draw() {
    const stop = pick("pick-stop").value;
    const faceText = pick("pick-face").value;
    const enlarged = Number(pick("pick-scale").value) || fit;
    const lines = ["", "", "", ""], dots = ["", "", "", ""];
    let crosses = "", n = 0, sum = 0, left = 0;
    const unit = W / 640, reach = Math.max(3.2 * sigma, 1e-9), C = 150, c = (v) => (C * (1 + Math.max(-1, Math.min(1, v / reach)) * 0.86)).toFixed(1);
    for (const s of R.stops) {
      if (stop && s.stop !== stop) continue;
      const wrong = new Set(s.wrong);
      for (let i = 0; i < s.u.length; i++) {
        const f = s.face[i];
        if (faceText !== "" && f !== Number(faceText)) continue;
        if (wrong.has(i)) {
          left++;
          const a = 4 * unit;
          crosses += `M${s.u[i] - a} ${s.v[i] - a}l${2 * a} ${2 * a}m0 ${-2 * a}l${-2 * a} ${2 * a}`;
          continue;
        }
        n++;
        sum += s.du[i] ** 2 + s.dv[i] ** 2;
        // From where it was expected (the seen place less the residual, at this scale the same place) outwards.
        lines[f] += `M${s.u[i]} ${s.v[i]}l${(s.du[i] * enlarged).toFixed(1)} ${(s.dv[i] * enlarged).toFixed(1)}`;
        dots[f] += `M${c(s.du[i])} ${c(s.dv[i])}h0`;
      }
    }
    field.replaceChildren();
    const svg = node(field, "svg", { viewBox: `${-0.5 - 8 * unit} ${-0.5 - 8 * unit} ${W + 16 * unit} ${H + 16 * unit}`, "aria-hidden": "true", focusable: "false" });
    if (stop && DATA.photographs[stop]) node(svg, "image", { href: DATA.photographs[stop], x: -0.5, y: -0.5, width: W, height: H, class: "photo" });
    node(svg, "rect", { x: -0.5, y: -0.5, width: W, height: H, class: "axis" });
    for (let k = 1; k < 4; k++) node(svg, "path", { d: `M${(k * W) / 4} -0.5v${H}M-0.5 ${(k * H) / 4}h${W}`, class: "hair" });
    lines.forEach((d, f) => { if (d) node(svg, "path", { d, class: `vectors face${f}`, "stroke-width": 1.1 * unit }); });
    if (crosses) node(svg, "path", { d: crosses, class: "cross" });
    cloud.replaceChildren();
    const dial = chart(cloud, 300, 300);
    node(dial, "path", { d: `M${C} 14V286M14 ${C}H286`, class: "hair" });
    [1, 2].forEach((m) => {
      const r = (C * 0.86 * m * sigma) / reach;
      node(dial, "circle", { cx: C, cy: C, r, class: "axis" });
      node(dial, "text", { x: C + 4, y: C - r - 4 }, `${(m * sigma).toPrecision(2)} px`);
    });
    dots.forEach((d, f) => { if (d) node(dial, "path", { d, class: `dots face${f}` }); });
    node(dial, "text", { x: 286, y: C - 5, "text-anchor": "end" }, "u");
    node(dial, "text", { x: C + 6, y: 292 }, "v");
    pick("residual-says").textContent = n ? `${n} corners, root mean square ${Math.sqrt(sum / n).toFixed(3)} px` + (left ? `, ${left} left out` : "") : "no corner";
    pick("residual-scale").textContent = `Lines are enlarged ${enlarged} times.` + (R.every > 1 ? ` One corner in ${R.every} is drawn.` : "");
    document.dispatchEvent(new CustomEvent("stopchosen", { detail: stop }));
    document.dispatchEvent(new CustomEvent("enlarged", { detail: enlarged }));
  }
  ["pick-stop", "pick-face", "pick-scale"].forEach((id) => pick(id).addEventListener("change", draw));
  document.getElementById("residual-choices").addEventListener("submit", (e) => e.preventDefault());
  draw();
})();
