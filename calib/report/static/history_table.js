// The table of a fleet's history.
(function () {
  const R = DATA.rows, plain = (field) => (cell, i) => { cell.textContent = R[i][field] === null ? "" : R[i][field]; };
  function name(cell, i) {
    if (!R[i].link) return void (cell.textContent = R[i].robot);
    const a = document.createElement("a");
    a.href = R[i].link;
    a.textContent = R[i].robot;
    cell.appendChild(a);
  }
  const by = (field) => (i) => R[i][field];
  const columns = [
    { head: true, value: by("robot"), fill: name },
    { kind: "n", value: by("drives"), fill: plain("drives") },
    { value: by("last"), fill: plain("last") },
    { kind: "n", value: by("left"), fill: plain("left_said") },
    { kind: "n", value: by("right"), fill: plain("right_said") },
    { kind: "n", value: by("scatter"), fill: plain("scatter") },
    { value: by("due_key"), fill: plain("due") },
    { value: by("changes"), fill: plain("changes") },
    { value: by("hardware"), fill: plain("hardware") },
  ];
  const words = document.getElementById("filter-text"), changed = document.getElementById("filter-changed");
  const low = R.map((r) => `${r.robot} ${r.hardware}`.toLowerCase());
  const keep = (i) => low[i].includes(words.value.trim().toLowerCase()) && (!changed.checked || R[i].changes !== "");
  const shown = pagedTable({
    table: document.getElementById("history-table"), rows: R.length, order: DATA.order, columns, keep,
    says: document.getElementById("filter-says"), noun: "robots",
  });
  words.addEventListener("input", shown.filter);
  changed.addEventListener("change", shown.filter);
  document.getElementById("filter").addEventListener("submit", (e) => e.preventDefault());
})();
