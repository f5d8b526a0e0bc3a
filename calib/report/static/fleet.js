// The fleet's table sorts and filters; one strip of points a parameter.
(function () {
  const table = document.getElementById("robot-table");
  if (table) {
    const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
    const rows = [...body.rows];
    const key = (row, column) => row.cells[column].dataset.value;
    const collator = new Intl.Collator(undefined, { numeric: true });
    function compare(a, b) {
      if (a === "" || b === "") return (a === "") - (b === "");
      const x = Number(a), y = Number(b);
      return Number.isNaN(x) || Number.isNaN(y) ? collator.compare(a, b) : x - y;
    }
    heads.forEach((head, column) => head.querySelector("button").addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((h) => h.setAttribute("aria-sort", "none"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      rows.sort((p, q) => {
        const a = key(p, column), b = key(q, column);
        // What is missing stays last, whichever way.
        return a === "" || b === "" ? compare(a, b) : down ? compare(b, a) : compare(a, b);
      });
      body.append(...rows);
    }));
    const text = document.getElementById("filter-text"), level = document.getElementById("filter-level"), odd = document.getElementById("filter-odd");
    function filter() {
      const words = text.value.trim().toLowerCase();
      let shown = 0;
      for (const row of rows) {
        const fits = row.cells[0].textContent.toLowerCase().includes(words) && (!level.value || row.dataset.level === level.value) && (!(odd && odd.checked) || row.dataset.odd === "1");
        row.hidden = !fits;
        shown += fits;
      }
      document.getElementById("filter-says").textContent = `${shown} of ${rows.length} robots`;
    }
    text.addEventListener("input", filter);
    level.addEventListener("change", filter);
    if (odd) odd.addEventListener("change", filter);
    document.getElementById("filter").addEventListener("submit", (e) => e.preventDefault());
  }

  const where = document.getElementById("spread-charts");
  if (!where) return;
  // So many robots get a line each with their name; of more only those that are far from the others are named.
  const NAMED = 16;
  const short = (name) => (name.length > 16 ? name.slice(0, 15) + "\u2026" : name);
  for (const panel of DATA.panels) {
    const n = panel.value.length, named = n <= NAMED;
    const longest = named ? Math.min(16, Math.max(...DATA.robots.map((r) => r.length))) : 0;
    const W = 360, left = 16 + 6.6 * longest, right = 16, top = 32, base = named ? top + 15 * n : 84, H = base + 28;
    const svg = chart(where, W, H);
    node(svg, "text", { x: 12, y: 18, class: "title" }, `${panel.name}${panel.unit ? ", " + panel.unit : ""}`);
    const reach = panel.value.map((v, i) => [v - 2 * (panel.sigma[i] || 0), v + 2 * (panel.sigma[i] || 0)]);
    // Robots that are hardly known must not squeeze all others together.
    let low = Math.min(...panel.value), high = Math.max(...panel.value);
    const typical = quantile(panel.sigma.map((s) => s || 0), 0.5);
    low -= 2 * typical + 0.04 * (high - low) + 1e-9;
    high += 2 * typical + 0.04 * (high - low) + 1e-9;
    const x = (v) => (left + ((Math.max(low, Math.min(high, v)) - low) / (high - low)) * (W - left - right)).toFixed(1);
    const t = ticks(low, high, 5);
    t.at.forEach((v) => {
      node(svg, "path", { d: `M${x(v)} ${top - 4}V${base}`, class: "hair" });
      node(svg, "text", { x: x(v), y: base + 16, "text-anchor": "middle" }, tickText(v, t.step));
    });
    const sorted = [...panel.value].sort((a, b) => a - b);
    const middle = (sorted[(n - 1) >> 1] + sorted[n >> 1]) / 2;
    if (n > 2) node(svg, "path", { d: `M${x(middle)} ${top - 4}V${base}`, class: "final" });
    const step = Math.min(9, (base - top) / Math.max(n, 1));
    panel.value.forEach((v, i) => {
      const y = named ? top + 15 * i + 4 : top + ((i * 0.618034) % 1) * (base - top - 4);
      if (named) node(svg, "text", { x: left - 12, y: y + 4, "text-anchor": "end", class: panel.odd[i] ? "out-text" : "" }, short(DATA.robots[i]));
      node(svg, "path", { d: `M${x(reach[i][0])} ${y.toFixed(1)}H${x(reach[i][1])}`, class: "whisker", "stroke-width": Math.max(2, step / 2) });
      const dot = node(svg, "circle", { cx: x(v), cy: y.toFixed(1), r: panel.odd[i] ? 4.4 : 3, class: panel.odd[i] ? "bar out" : "point" });
      node(dot, "title", {}, `${DATA.robots[i]}: ${v}`);
      if (panel.odd[i] && !named) node(svg, "text", { x: x(v), y: y - 7, "text-anchor": Number(x(v)) > W / 2 ? "end" : "start", class: "out-text" }, short(DATA.robots[i]));
    });
  }
})();
