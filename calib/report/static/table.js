// A table of many rows: sorted and filtered as arrays, shown a page at a time. The page comes with its first rows, and shows so many at once.
function pagedTable({ table, rows, order, columns, keep, says, noun, size = table.tBodies[0].rows.length, changed }) {
  const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells], labels = heads.map((h) => h.textContent.trim());
  const pager = table.closest(".paged, section").querySelector(".pager");
  const collator = new Intl.Collator(undefined, { numeric: true });
  const keys = [];
  let sorted = [...order], shown = sorted, page = 0;

  // Texts are compared once: what a column sorts by are numbers, and NaN where there is nothing.
  function key(column) {
    if (keys[column]) return keys[column];
    const values = Array.from({ length: rows }, (_, i) => columns[column].value(i));
    const texts = values.some((v) => typeof v === "string");
    const out = new Float64Array(rows);
    if (texts) {
      const different = [...new Set(values)].filter((v) => v !== "" && v !== null).sort(collator.compare);
      const rank = new Map(different.map((v, k) => [v, k]));
      values.forEach((v, i) => { out[i] = rank.has(v) ? rank.get(v) : NaN; });
    } else values.forEach((v, i) => { out[i] = v === null || v === undefined ? NaN : v; });
    return (keys[column] = out);
  }

  function sortBy(column, down) {
    const k = key(column), sign = down ? -1 : 1;
    // What is missing stays last, whichever way.
    sorted = [...order].sort((p, q) => {
      const a = k[p], b = k[q];
      if (a !== a || b !== b) return (a !== a) - (b !== b);
      return sign * (a - b);
    });
  }

  function row(i) {
    const tr = document.createElement("tr");
    columns.forEach((column, c) => {
      const cell = document.createElement(column.head ? "th" : "td"), value = column.value(i);
      if (column.head) cell.scope = "row";
      if (column.kind) cell.className = column.kind;
      cell.dataset.value = value === null || value === undefined ? "" : value;
      cell.dataset.label = labels[c];
      column.fill(cell, i);
      if (cell.textContent.length + labels[c].length > 20) cell.classList.add("long");
      tr.appendChild(cell);
    });
    return tr;
  }

  function show() {
    const part = document.createDocumentFragment();
    for (const i of shown.slice(page * size, (page + 1) * size)) part.appendChild(row(i));
    body.replaceChildren(part);
    tell();
  }

  function tell() {
    says.textContent = shown.length === rows ? `${rows} ${noun}` : `${shown.length} of ${rows} ${noun}`;
    if (!pager) return;
    const [back, on] = pager.querySelectorAll("button"), last = Math.max(0, Math.ceil(shown.length / size) - 1);
    pager.hidden = last === 0;
    back.disabled = page === 0;
    on.disabled = page === last;
    pager.querySelector("span").textContent = shown.length ? `${page * size + 1}\u2013${Math.min((page + 1) * size, shown.length)} of ${shown.length}` : "";
  }

  function filter() {
    shown = sorted.filter(keep);
    page = 0;
    show();
    if (changed) changed(shown);
  }

  heads.forEach((head, column) => head.querySelector("button").addEventListener("click", () => {
    const down = head.getAttribute("aria-sort") === "ascending";
    heads.forEach((h) => h.setAttribute("aria-sort", "none"));
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    sortBy(column, down);
    shown = sorted.filter(keep);
    page = 0;
    show();
  }));
  if (pager) pager.querySelectorAll("button").forEach((button, k) => button.addEventListener("click", () => {
    page += k ? 1 : -1;
    show();
    table.closest(".scroll").scrollIntoView({ block: "start" });
  }));
  shown = sorted.filter(keep);
  tell();
  return { filter };
}

function signed(value, digits) {
  return value === null || value === undefined ? "" : value.toFixed(digits).replace("-", "\u2212");
}

// A column of one figure, outliers marked.
function figureColumn(panel) {
  const odd = new Set(panel.odd);
  return {
    kind: "n", value: (i) => panel.value[i],
    fill: (cell, i) => {
      cell.textContent = signed(panel.value[i], panel.digits);
      if (!odd.has(i)) return;
      cell.classList.add("odd");
      const mark = document.createElement("span"), words = document.createElement("span");
      mark.ariaHidden = "true";
      mark.textContent = "\u25c6 ";
      words.className = "hidden";
      words.textContent = "odd: ";
      cell.replaceChildren(mark, words, signed(panel.value[i], panel.digits));
    },
  };
}

function verdictCell(cell, level) {
  const mark = document.querySelector(`.mark.${level}`);
  if (mark) cell.append(mark.cloneNode(true));
  cell.append(level);
}

function linkedName(cell, name, address) {
  if (!address) { cell.textContent = name; return; }
  const a = document.createElement("a");
  a.href = address;
  a.textContent = name;
  cell.appendChild(a);
}
