"use strict";
// Hints where a table is wider than the screen, and nothing folded in print.
(() => {
  const narrow = () => document.querySelectorAll(".scroll, .wide").forEach((s) => s.classList.toggle("narrow", s.scrollWidth > s.clientWidth + 1));
  narrow();
  addEventListener("resize", narrow);
  addEventListener("toggle", narrow, true);  // of details, which do not let it rise
  let closed = [];
  addEventListener("beforeprint", () => { closed = [...document.querySelectorAll("details:not([open])")]; closed.forEach((d) => { d.open = true; }); });
  addEventListener("afterprint", () => closed.forEach((d) => { d.open = false; }));
})();
