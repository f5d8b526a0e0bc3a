// Tables of all cameras, and of all pairs of cameras, of robots with several.
(function () {
  const LEVELS = ["good", "usable", "redo"];

  function make(key, noun, D) {
    const table = document.getElementById(`${key}-table`);
    if (!table || !D) return;
    const text = (tokens) => (i) => tokens[0][tokens[1][i]];
    const words = D.words.map(text), level = (i) => (D.level[i] === null ? "" : LEVELS[D.level[i]]);
    const plain = (of) => ({ value: of, fill: (cell, i) => { cell.textContent = of(i); } });
    const columns = [{ head: true, value: (i) => D.robots[i], fill: (cell, i) => linkedName(cell, D.robots[i], D.links[i]) }, plain(words[0])];
    if (D.counts.length) columns.push(
      { kind: "level", value: (i) => D.level[i], fill: (cell, i) => { if (level(i)) verdictCell(cell, level(i)); } },
      { kind: "why", ...plain(words[1]) },
      { kind: "n", value: (i) => D.counts[0][i], fill: (cell, i) => { cell.textContent = D.counts[0][i]; } },
      { kind: "n", value: (i) => D.counts[1][i], fill: (cell, i) => { cell.textContent = D.counts[1][i].toFixed(2); } },
    );
    else columns.push(plain(words[1]));
    columns.push(...D.panels.map(figureColumn));
    const field = document.getElementById(`${key}-text`);
    const low = D.robots.map((r, i) => `${r} ${words.map((w) => w(i)).join(" ")} ${level(i)}`.toLowerCase());
    const shown = pagedTable({
      table, rows: D.robots.length, order: D.robots.map((_, i) => i), columns, says: document.getElementById(`${key}-says`), noun,
      keep: (i) => low[i].includes(field.value.trim().toLowerCase()),
    });
    field.addEventListener("input", shown.filter);
    document.getElementById(`${key}-filter`).addEventListener("submit", (e) => e.preventDefault());
  }

  make("camera", "cameras", DATA.cameras);
  make("pair", "pairs", DATA.pairs);
})();
