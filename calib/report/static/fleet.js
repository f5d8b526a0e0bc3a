// The fleet's table: what its cells hold, and what is asked of it.
(function () {
  const table = document.getElementById("robot-table");
  if (!table) return;
  const R = DATA.rows, LEVELS = ["good", "usable", "redo"];
  const anyOdd = new Set(DATA.panels.flatMap((p) => p.odd));
  const low = DATA.robots.map((r) => r.toLowerCase());
  const level = (i) => LEVELS[R.level[i]], text = (tokens) => (i) => tokens[0][tokens[1][i]];
  const why = text(R.why), stale = text(R.stale), hardware = text(R.hardware);
  const unknown = { straight: text(R.straight_said), turn: text(R.turn_said) };
  const plain = (cell, words) => { cell.textContent = words; };

  function length(m) {
    if (m === null) return "";
    if (m < 0.01) return m < 0.000995 ? `${Number((m * 1e3).toPrecision(2))} mm` : `${(m * 1e3).toFixed(1)} mm`;
    return m < 1 ? `${(m * 100).toFixed(1)} cm` : `${m.toFixed(1)} m`;
  }
  function name(cell, i) {
    linkedName(cell, DATA.robots[i], R.linked[i] && `./${encodeURIComponent(DATA.robots[i])}/report.html`);
  }
  function verdict(cell, i) {
    verdictCell(cell, level(i));
    if (!stale(i)) return;
    const tag = document.createElement("span");
    tag.className = "tag stale";
    tag.textContent = "stale";
    cell.append(" ", tag);
  }
  function reasons(cell, i) {
    if (stale(i)) {
      const b = document.createElement("b");
      b.textContent = stale(i);
      cell.append(b, " ");
    }
    cell.append(why(i));
  }
  const angle = (a) => (a === null ? "" : a < 0.0995 ? `${a.toFixed(3)}\u00b0` : `${a.toFixed(2)}\u00b0`);
  const columns = [
    { head: true, value: (i) => DATA.robots[i], fill: name },
    { kind: "level", value: (i) => R.level[i], fill: verdict },
    { kind: "why", value: (i) => stale(i) + why(i), fill: reasons },
    { kind: "n", value: (i) => R.straight[i], fill: (cell, i) => plain(cell, length(R.straight[i]) || unknown.straight(i)) },
    { kind: "n", value: (i) => R.turn[i], fill: (cell, i) => plain(cell, angle(R.turn[i]) || unknown.turn(i)) },
    { kind: "n", value: (i) => R.stops[i], fill: (cell, i) => plain(cell, R.stops[i]) },
    { kind: "n", value: (i) => R.rms[i], fill: (cell, i) => plain(cell, R.rms[i].toFixed(2)) },
    ...DATA.panels.map(figureColumn),
  ];
  if (R.hardware[0].some((h) => h)) columns.push({ value: hardware, fill: (cell, i) => plain(cell, hardware(i)) });

  const field = (id) => document.getElementById(id);
  const words = field("filter-text"), wanted = field("filter-level"), outliers = field("filter-odd"), revision = field("filter-hardware");
  function keep(i) {
    return low[i].includes(words.value.trim().toLowerCase()) && (!wanted.value || level(i) === wanted.value)
      && (!outliers || !outliers.checked || anyOdd.has(i)) && (!revision || revision.value === "*" || hardware(i) === revision.value);
  }
  const shown = pagedTable({
    table, rows: DATA.robots.length, order: R.order, columns, keep, says: field("filter-says"), noun: "robots",
    changed: (kept) => { if (window.plotRobots) window.plotRobots(kept); },
  });
  words.addEventListener("input", shown.filter);
  for (const choice of [wanted, outliers, revision]) if (choice) choice.addEventListener("change", shown.filter);
  field("filter").addEventListener("submit", (e) => e.preventDefault());
  window.keptRobots = () => R.order.filter(keep);
})();
