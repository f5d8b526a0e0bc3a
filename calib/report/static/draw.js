"use strict";
// Shared by all charts: the data in the page, and SVG by small steps.
const DATA = JSON.parse(document.getElementById("data").textContent);
const SVG = "http://www.w3.org/2000/svg";

function node(parent, name, attributes, text) {
  const e = document.createElementNS(SVG, name);
  for (const key in attributes) e.setAttribute(key, attributes[key]);
  if (text !== undefined) e.textContent = text;
  parent.appendChild(e);
  return e;
}

// Tables of figures become lists of their rows on narrow screens (style.css): every cell knows its heading.
document.querySelectorAll(".scroll table:not(.parameters)").forEach((table) => {
  if (!table.tHead) return;
  const heads = [...table.tHead.rows[0].cells].map((cell) => cell.textContent.trim());
  if (!table.classList.contains("robots")) table.classList.add("stacked");
  for (const row of table.tBodies[0].rows) [...row.cells].forEach((cell, k) => {
    cell.dataset.label = heads[k];
    if (cell.textContent.length + heads[k].length > 20) cell.classList.add("long");
  });
});

function chart(where, width, height) {
  const svg = node(where, "svg", { viewBox: `0 0 ${width} ${height}`, "aria-hidden": "true", focusable: "false" });
  return svg;
}

// Round steps that cut an interval into about n parts.
function ticks(low, high, n) {
  const raw = (high - low) / n;
  if (!(raw > 0)) return { step: 1, at: [low] };
  const power = Math.pow(10, Math.floor(Math.log10(raw)));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw) || raw;
  const at = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) at.push(k * step);
  return { step, at };
}

function tickText(value, step) {
  const places = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return (Math.abs(value) < step / 1e3 ? 0 : value).toFixed(Math.min(places, 8)).replace("-", "\u2212");
}

function quantile(values, q) {
  const sorted = values.filter((v) => v !== null).sort((a, b) => a - b);
  if (!sorted.length) return 0;
  return sorted[Math.min(sorted.length - 1, Math.floor(q * sorted.length))];
}
