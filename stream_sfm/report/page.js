"use strict";
// Values under the pointer, hints where a table is wider than the screen. The page is complete without this.
(() => {
  const tip = document.getElementById("tip");
  const show = (v) => (v === 0 ? "0" : Math.abs(v) >= 1000 || Math.abs(v) < 0.001 ? v.toExponential(2) : String(+v.toPrecision(4)));
  for (const svg of document.querySelectorAll("svg[data-scale]")) {
    const [x0, x1, lx, y0, y1, ly] = svg.dataset.scale.split(",").map(Number);
    const [left, right, top, bottom] = svg.dataset.box.split(",").map(Number);
    const toX = (p) => { const v = x0 + ((p - left) / (right - left)) * (x1 - x0); return lx ? 10 ** v : v; };
    const toY = (p) => { const v = y0 + ((bottom - p) / (bottom - top)) * (y1 - y0); return ly ? 10 ** v : v; };
    const cursor = document.createElementNS("http://www.w3.org/2000/svg", "path");
    cursor.setAttribute("class", "cursor");
    svg.append(cursor);
    let groups = null;
    const load = () => [...svg.querySelectorAll("g[data-name]")].map((g) => {
      const lines = [...g.querySelectorAll("polyline")].flatMap((l) => l.getAttribute("points").split(" ").map((p) => p.split(",").map(Number)));
      const dots = [...g.querySelectorAll("circle")].map((c) => [+c.getAttribute("cx"), +c.getAttribute("cy")]);
      const any = g.querySelector("polyline, circle");
      return { name: g.dataset.name, points: lines.length ? lines : dots, colour: any ? getComputedStyle(any).getPropertyValue("--c") : "" };
    });
    const hide = () => { tip.hidden = true; cursor.setAttribute("d", ""); };
    svg.addEventListener("pointerleave", hide);
    svg.addEventListener("pointermove", (event) => {
      groups = groups || load();
      const box = svg.getBoundingClientRect();
      const px = ((event.clientX - box.left) / box.width) * svg.viewBox.baseVal.width;
      if (px < left || px > right) return hide();
      const rows = [];
      let at = null;
      for (const { name, points, colour } of groups) {
        if (!points.length) continue;
        let best = points[0];
        for (const p of points) if (Math.abs(p[0] - px) < Math.abs(best[0] - px)) best = p;
        if (Math.abs(best[0] - px) > 25) continue;
        if (at === null || Math.abs(best[0] - px) < Math.abs(at - px)) at = best[0];
        rows.push([name, toY(best[1]), colour]);
      }
      if (at === null) return hide();
      cursor.setAttribute("d", `M${at} ${top}V${bottom}`);
      tip.replaceChildren();
      const head = document.createElement("b");
      head.textContent = show(toX(at));
      tip.append(head);
      for (const [name, value, colour] of rows) {
        const row = document.createElement("div"), dot = document.createElement("i");
        dot.style.background = colour;
        row.append(dot, `${name}: ${show(value)}`);
        tip.append(row);
      }
      tip.hidden = false;
      tip.style.left = `${Math.max(4, Math.min(event.pageX + 14, scrollX + document.documentElement.clientWidth - tip.offsetWidth - 6))}px`;
      tip.style.top = `${event.pageY + 14}px`;
    });
  }
  const narrow = () => document.querySelectorAll(".scroll, .wide").forEach((s) => s.classList.toggle("narrow", s.scrollWidth > s.clientWidth + 1));
  narrow();
  addEventListener("resize", narrow);
  addEventListener("toggle", narrow, true);  // of details, which do not let it rise
  let closed = [];  // printing shows everything
  addEventListener("beforeprint", () => { closed = [...document.querySelectorAll("details:not([open])")]; closed.forEach((d) => { d.open = true; }); });
  addEventListener("afterprint", () => closed.forEach((d) => { d.open = false; }));
})();
