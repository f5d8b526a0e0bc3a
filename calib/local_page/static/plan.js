"use strict";
/* The floor from above, in the box's frame: x to the right, y up, metres. Shared by the guide and the simulated robot. */
const Plan = (() => {
  const NS = "http://www.w3.org/2000/svg";
  const make = (name, attributes, text) => {
    const node = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    if (text !== undefined) node.textContent = text;
    return node;
  };
  const arrow = (size) => `M ${0.9 * size} 0 L ${-0.6 * size} ${0.62 * size} L ${-0.3 * size} 0 L ${-0.6 * size} ${-0.62 * size} Z`;
  const placed = (at) => `translate(${at.x} ${-at.y}) rotate(${-at.heading * 180 / Math.PI})`;

  function extent(plan, aspect, before) {
    const half = Math.max(...plan.box) / 2;
    const all = [[half, half], [-half, -half]];
    for (const at of [...plan.stops, ...plan.next, plan.robot].filter(Boolean)) all.push([at.x, at.y]);
    for (const at of plan.next) all.push(...(at.points || []));
    const reach = Math.max(...all.map(([x, y]) => Math.max(Math.abs(x) / aspect, Math.abs(y)))) + 0.3;
    const wanted = Math.max(0.9, Math.ceil(reach * 4) / 4);
    return before && wanted <= before && wanted > 0.6 * before ? before : wanted;
  }

  function draw(svg, plan) {
    const bounds = svg.getBoundingClientRect();
    const aspect = bounds.height > 0 ? bounds.width / bounds.height : 4 / 3;
    const h = extent(plan, aspect, Number(svg.dataset.h) || 0);
    svg.dataset.h = h;
    const w = h * aspect, unit = 2 * h / Math.max(bounds.height, 1), text = 13 * unit;
    svg.setAttribute("viewBox", `${-w} ${-h} ${2 * w} ${2 * h}`);
    const nodes = [];
    for (let k = Math.ceil(-w / 0.5); k <= w / 0.5; k++) nodes.push(make("line", { class: "grid", x1: k * 0.5, x2: k * 0.5, y1: -h, y2: h }));
    for (let k = Math.ceil(-h / 0.5); k <= h / 0.5; k++) nodes.push(make("line", { class: "grid", x1: -w, x2: w, y1: k * 0.5, y2: k * 0.5 }));
    const [bw, bd] = plan.box;
    nodes.push(make("rect", { class: "box", x: -bw / 2, y: -bd / 2, width: bw, height: bd }));
    const size = Math.max(Math.min(0.07, 11 * unit), 9 * unit);
    const room = bw > 3 * size;
    for (const [face, x, y] of [[0, 1, 0], [1, 0, 1], [2, -1, 0], [3, 0, -1]]) {
      const out = room ? 0.34 : 0.5 + 0.8 * size / bw;
      nodes.push(make("text", { class: room ? "face" : "face outside", x: x * bw * out, y: -y * bd * out, "font-size": size }, face));
    }
    const body = Math.max(plan.size * 0.7, 11 * unit);
    for (const stop of plan.stops) {
      const dx = Math.cos(stop.heading), dy = -Math.sin(stop.heading);
      nodes.push(make("line", { class: "look", x1: stop.x, y1: -stop.y, x2: stop.x + dx * body * 1.1, y2: -stop.y + dy * body * 1.1 }));
      nodes.push(make("circle", { class: "stop", cx: stop.x, cy: -stop.y, r: 5 * unit }));
      nodes.push(make("text", { class: "stop-n", x: stop.x - dx * 14 * unit, y: -stop.y - dy * 14 * unit, "font-size": text }, stop.n));
    }
    plan.next.slice().reverse().forEach((goal, k) => {
      const later = k < plan.next.length - 1 ? " later" : "";
      if (goal.points && goal.points.length > 1) {
        nodes.push(make("polyline", { class: "way", points: goal.points.map(([x, y]) => `${x},${-y}`).join(" ") }));
      }
      const mark = make("g", { transform: placed(goal), "data-next": later ? "later" : "now" });
      mark.append(make("circle", { class: "goal" + later, r: body * 1.15 }), make("path", { class: "goal-dot" + later, d: arrow(body * 0.7) }));
      nodes.push(mark);
    });
    if (plan.robot) {
      const rough = plan.robot.source === "camera" ? " rough" : "";
      nodes.push(make("path", { class: "robot" + rough, d: arrow(body), transform: placed(plan.robot) }));
    }
    const x0 = -w + 14 * unit, y0 = h - 14 * unit;
    nodes.push(make("line", { class: "scale", x1: x0, x2: x0 + 0.5, y1: y0, y2: y0 }));
    nodes.push(make("text", { class: "scale-text", x: x0, y: y0 - 7 * unit, "font-size": 12 * unit }, "0.5 m"));
    svg.replaceChildren(...nodes);
  }
  return { draw, make };
})();
