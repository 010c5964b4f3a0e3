// What is cut, covered or outside on the page as it stands: a list of words, empty where all is well.
() => {
  const wrong = [];
  const width = document.documentElement.clientWidth;
  const wider = document.documentElement.scrollWidth - width;
  if (wider > 0) wrong.push(`page wider than its window by ${wider}`);
  const homes = ".panel, .bar, .banner, .health, .transport, .menu-items, dialog";
  const scrolls = "#strokes, #comparison, #visit-map-list, dialog"; // these scroll
  const name = (e) => `${e.closest("[id]")?.id} ${e.tagName}.${e.className} ${e.textContent.trim().slice(0, 30)}`;
  const look = (e, box) => {
    const home = e.closest(homes)?.getBoundingClientRect();
    if (!box.width || !home) return;
    if (box.left < -0.5 || box.right > width + 0.5) wrong.push(`outside the window: ${name(e)}`);
    if (box.left < home.left - 0.5 || box.right > home.right + 0.5) wrong.push(`outside its panel: ${name(e)}`);
    if (!e.closest(scrolls) && (box.top < home.top - 0.5 || box.bottom > home.bottom + 0.5)) wrong.push(`below its panel: ${name(e)}`);
  };
  for (const e of document.querySelectorAll("body *")) {
    if (!e.checkVisibility({ checkVisibilityCSS: true }) || e.closest(".hidden, .skip, option, select, #toasts")) continue;
    for (const node of e.childNodes) {
      if (node.nodeType !== 3 || !node.textContent.trim()) continue;
      const range = document.createRange();
      range.selectNodeContents(node);
      if (e.id !== "device") for (const box of range.getClientRects()) look(e, box); // it ends in dots, and has a title
    }
    if (e.matches("button, select, input, summary, canvas, .range")) look(e, e.getBoundingClientRect());
    const style = getComputedStyle(e);
    if (e.id !== "device" && style.overflowX !== "visible" && e.scrollWidth > e.clientWidth + 1) wrong.push(`cut: ${name(e)}`);
  }
  const panels = [...document.querySelectorAll(".panel")].map((e) => [e.className, e.getBoundingClientRect()]);
  panels.forEach(([a, p], i) => panels.slice(i + 1).forEach(([b, q]) => {
    if (p.left < q.right - 0.5 && q.left < p.right - 0.5 && p.top < q.bottom - 0.5 && q.top < p.bottom - 0.5) wrong.push(`${a} over ${b}`);
  }));
  return [...new Set(wrong)];
}
