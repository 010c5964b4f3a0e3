// Two visits side by side: what has changed, and whether by more than strokes differ among themselves.

import { element } from "./dom.js";

const NAMES = { d_mm: "Diameter, mm", depth_mm: "Depth, mm", t_mm: "Thickness, mm", F_N_per_m: "Force, N/m" };
const signed = (v) => `${v < 0 ? "\u2212" : "+"}${Math.abs(v).toFixed(1)}`;

/** The nodes that show what the server found. */
export function comparison(found) {
  const main = found.d_mm;
  const text = main?.text ?? "One of the visits holds no stroke with a diameter yet.";
  const result = element("p", { class: main?.beyond ? "result beyond" : "result" }, text);
  if (!main) return [result];
  const table = element("table");
  table.innerHTML = "<thead><tr><th></th><th>earlier</th><th>later</th><th>change</th></tr></thead>";
  const body = table.createTBody();
  for (const [key, name] of Object.entries(NAMES)) {
    const row = found[key];
    if (!row) continue;
    const line = body.insertRow();
    line.insertCell().textContent = name;
    for (const { mean, sd } of [row.a, row.b]) {
      const cell = line.insertCell();
      cell.textContent = mean.toFixed(1);
      if (sd === null) continue;
      cell.title = `spread (sd) ${sd.toFixed(1)}`;
      cell.append(element("span", { class: "spread" }, ` ± ${sd.toFixed(1)}`));
    }
    const change = line.insertCell();
    change.textContent = signed(row.change);
    if (row.change_low === null) continue;
    change.append(element("small", {}, ` (${signed(row.change_low)} to ${signed(row.change_high)})`));
  }
  const words = element("p", { class: "small-print" }, found.assumes);
  return [result, table, element("details", {}, element("summary", {}, "95 % intervals; what they take for granted"), words)];
}
