// Photographs of the stops with their corners' residuals; each is drawn when it is unfolded, or printed.
(function () {
  const R = DATA.residuals, [W, H] = R.size, unit = W / 640;
  let enlarged = 1;
  function draw(fold) {
    const s = R.stops.find((x) => x.stop === fold.dataset.stop), where = fold.querySelector("figure");
    const wrong = new Set(s.wrong), lines = ["", "", "", ""];
    let crosses = "";
    s.u.forEach((u, i) => {
      const v = s.v[i], a = 4 * unit;
      if (wrong.has(i)) crosses += `M${u - a} ${v - a}l${2 * a} ${2 * a}m0 ${-2 * a}l${-2 * a} ${2 * a}`;
      else lines[s.face[i]] += `M${u} ${v}l${(s.du[i] * enlarged).toFixed(1)} ${(s.dv[i] * enlarged).toFixed(1)}`;
    });
    where.replaceChildren();
    const svg = node(where, "svg", { viewBox: `-0.5 -0.5 ${W} ${H}`, "aria-hidden": "true", focusable: "false" });
    node(svg, "image", { href: DATA.photographs[s.stop], x: -0.5, y: -0.5, width: W, height: H });
    lines.forEach((d, f) => {
      if (!d) return;
      node(svg, "path", { d, class: "halo", "stroke-width": 4 * unit });
      node(svg, "path", { d, class: `vectors face${f}`, "stroke-width": 2 * unit });
    });
    if (crosses) node(svg, "path", { d: crosses, class: "cross", "stroke-width": 2 * unit });
  }
  const folds = [...document.querySelectorAll(".photograph")];
  folds.forEach((fold) => fold.addEventListener("toggle", () => { if (fold.open) draw(fold); }));
  document.addEventListener("enlarged", (e) => {
    enlarged = e.detail;
    folds.filter((fold) => fold.open).forEach(draw);
  });
  const pick = document.getElementById("pick-scale");
  if (pick) pick.dispatchEvent(new Event("change"));
})();
