// What a reader would find cut off or printed over in a page as it is shown: sentences, one for each fault.
(() => {
  document.querySelectorAll("details").forEach((d) => { d.open = true; });
  return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(faults()))));

  function shown(e) {
    if (e.closest(".hidden, .skip, [hidden], script, style, title, option, select") || e.tagName === "TITLE") return false;
    for (let a = e; a; a = a.parentElement) if (getComputedStyle(a).clipPath !== "none") return false; // for screen readers alone
    const style = getComputedStyle(e);
    return style.visibility !== "hidden" && style.display !== "none" && e.getClientRects().length > 0;
  }

  function pieces() {
    const out = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walk.nextNode()) {
      const text = walk.currentNode, owner = text.parentElement;
      if (!text.nodeValue.trim() || !shown(owner)) continue;
      const range = document.createRange();
      range.selectNodeContents(text);
      for (const r of range.getClientRects()) if (r.width > 1 && r.height > 1) out.push({ owner, text: text.nodeValue.trim().slice(0, 40), r });
    }
    return out;
  }

  function faults() {
    const found = [], all = pieces(), wide = document.documentElement.clientWidth;
    const name = (p) => `"${p.text}" in ${p.owner.tagName.toLowerCase()}.${p.owner.getAttribute("class") || ""}`;
    for (const p of all) {
      const scrolls = p.owner.closest(".scroll");
      if (!scrolls && (p.r.left < -1 || p.r.right > wide + 1)) found.push(`beyond the page: ${name(p)}`);
      for (let e = p.owner; e && e !== document.body; e = e.parentElement) {
        if (e === scrolls) break;
        const clips = e instanceof SVGSVGElement || ["hidden", "clip"].includes(getComputedStyle(e).overflowX);
        const box = e.getBoundingClientRect();
        if (clips && (p.r.left < box.left - 1.5 || p.r.right > box.right + 1.5 || p.r.top < box.top - 2.5 || p.r.bottom > box.bottom + 2.5)) {
          found.push(`cut by ${e.tagName.toLowerCase()}: ${name(p)}`);
          break;
        }
      }
    }
    all.sort((a, b) => a.r.top - b.r.top);
    all.forEach((p, i) => {
      for (let k = i + 1; k < all.length && all[k].r.top < p.r.bottom - 3; k++) {
        const q = all[k];
        const x = Math.min(p.r.right, q.r.right) - Math.max(p.r.left, q.r.left), y = Math.min(p.r.bottom, q.r.bottom) - Math.max(p.r.top, q.r.top);
        const lines = Math.min(p.r.height, q.r.height) * 0.4;
        const apart = p.owner.closest(".scroll") !== q.owner.closest(".scroll");
        if (x > 1.5 && y > lines && !apart) found.push(`${name(p)} over ${name(q)}`);
      }
    });
    for (const region of document.querySelectorAll(".scroll"))
      if (!(region.querySelector(".robots") && wide > 480) && region.scrollWidth > region.clientWidth + 1) found.push(`table must be scrolled: ${region.getAttribute("aria-label")}, ${region.scrollWidth} in ${region.clientWidth}`);
    return [...new Set(found)];
  }
})()
