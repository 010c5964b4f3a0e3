// The lines of the list of strokes.

import { element, timeOf } from "./dom.js";

/** The line over a visit's strokes. */
export const head = (text) => element("li", { class: "visit", role: "presentation" }, text);

/** The line of a stroke: its number, time and what was found. */
export function item({ card, number, wall_time }, picked) {
  const row = card.kind === "lump" && card.rows.find((r) => r.key === "d_mm");
  const parts = [["n", number], ["when", timeOf(wall_time)], ["what", card.title]];
  if (row) parts.push(["size", `${row.value.toFixed(1)} mm`], [`tag ${card.hardness ?? ""}`, card.hardness ?? ""]);
  const spans = parts.map(([name, text]) => element("span", { class: name }, text));
  const is = { id: `stroke-${number}`, "data-number": number, role: "option", "aria-selected": number === picked };
  return element("li", { ...is, class: row ? "" : "plain" }, ...spans);
}

/** Make the box hold these nodes in this order; those that stand right are not touched. */
export function arrange(box, nodes) {
  nodes.forEach((node, i) => {
    if (box.children[i] !== node) box.insertBefore(node, box.children[i] ?? null);
  });
  while (box.children.length > nodes.length) box.lastElementChild.remove();
}

/** Whether all of the line can be seen in the box. */
export function inSight(box, line) {
  const [outer, inner] = [box.getBoundingClientRect(), line.getBoundingClientRect()];
  return inner.top >= outer.top - 1 && inner.bottom <= outer.bottom + 1;
}

/** Scroll the page to a panel whose head is out of sight: below the bar, where that stays. */
export function show(panel) {
  const bar = document.querySelector(".bar");
  const above = getComputedStyle(bar).position === "sticky" ? bar.offsetHeight : 0;
  const { top } = panel.getBoundingClientRect();
  if (top < above || top > innerHeight / 2) scrollBy(0, top - above - 8);
}

/** Scroll the box, and not the page: on a phone that would take what is being read out of sight. */
export function reveal(box, line) {
  const [outer, inner] = [box.getBoundingClientRect(), line.getBoundingClientRect()];
  if (inner.top < outer.top) box.scrollTop -= outer.top - inner.top;
  else if (inner.bottom > outer.bottom) box.scrollTop += inner.bottom - outer.bottom;
}
