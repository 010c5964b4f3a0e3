// The estimate card: words and numbers from the server, an interval bar with its scale for each number.

import { decimal, element } from "./dom.js";
import { HALF_FACE_MM } from "./outline.js";

const SPANS = { d_mm: 30, width_mm: 30, depth_mm: 30, t_mm: 40, F_N_per_m: 150 };
const STIFFEST = 1000; // times fat: the end of the scale, and of what the models are for

const number = (v, unit) => decimal(v, unit === "N/m" ? 0 : 1);

/** A sentence with `commands` in it, as nodes: what stands between backticks is set as code. */
export function sentence(text) {
  return text.split("`").map((part, i) => (i % 2 ? element("code", {}, part) : part));
}

/** low, high, value and marks are shares of the scale from `from` to `to`. */
function range({ low, high, value, marks = [], from, to }) {
  const bar = element("div", { class: "range" });
  const place = (share) => `${(100 * Math.min(Math.max(share, 0), 1)).toFixed(1)}%`;
  const band = element("i");
  band.style.left = place(low);
  band.style.right = place(1 - high);
  bar.append(band);
  for (const mark of marks) {
    const line = element("u");
    line.style.left = place(mark);
    bar.append(line);
  }
  if (value !== null) {
    const tick = element("b");
    tick.style.left = place(value);
    bar.append(tick);
  }
  const scale = { class: "between", title: `${from} to ${to}`, "aria-hidden": "true" };
  return element("dd", scale, element("span", {}, from), bar, element("span", {}, to));
}

function quantity({ key, label, unit, value, low, high, beside }, hero, level) {
  const span = Math.max(SPANS[key] ?? high, 10 * Math.ceil(high / 10));
  const row = element("dl", { class: hero ? "quantity first" : "quantity", "data-key": key });
  const told = high - low <= 1e-4 * Math.abs(value); // an assumption of the model, but for rounding
  const words = told ? "assumed" : `${number(low, unit)} to ${number(high, unit)}`;
  const interval = element("span", { class: "range-text" }, hero && !told ? `${words} ${unit}, ${level}` : words);
  row.append(element("dt", {}, label));
  if (beside) row.firstChild.append(" ", element("span", { class: "beside", title: `${beside.label}: depth over diameter` }, `${beside.label} ${beside.value.toFixed(2)} of the diameter`));
  if (hero) {
    row.append(element("dd", { class: "hero" }, element("b", { class: "number" }, number(value, unit)), element("span", {}, unit), interval));
  } else row.append(element("dd", {}, element("b", { class: "number" }, `${number(value, unit)} ${unit}`), " ", interval));
  if (key === "place_mm") {
    const share = (v) => (v + HALF_FACE_MM) / (2 * HALF_FACE_MM);
    const ends = { from: number(-HALF_FACE_MM, unit), to: `${HALF_FACE_MM} ${unit}`, marks: [0.5] };
    row.append(range({ low: share(low), high: share(high), value: share(value), ...ends }));
  } else row.append(range({ low: low / span, high: high / span, value: value / span, from: "0", to: `${span} ${unit}` }));
  return row;
}

function stiffness({ hardness, hardness_text: words, stiffness_text: text, E_ratio: ratio }) {
  const row = element("dl", { class: "quantity", "data-key": "stiffness", title: words });
  row.append(element("dt", {}, "Stiffness"), element("dd", {}, element("b", { class: "number" }, hardness)));
  row.append(element("dd", { class: "between-text" }, element("span", { class: "range-text" }, text)));
  if (ratio) {
    const share = (e) => Math.log(Math.max(e, 1)) / Math.log(STIFFEST);
    const value = ratio.high === null || ratio.value === null ? null : share(ratio.value);
    const ends = { low: share(ratio.low ?? 1), high: ratio.high === null ? 1 : share(ratio.high), value };
    row.append(range({ ...ends, marks: [share(10)], from: "1", to: `${STIFFEST} × fat` }));
  }
  row.append(element("dd", { class: "wide" }, words));
  return row;
}

/** Where the lump lies: from the gland at the left to the fat at the right. */
function layer({ place, text, value, low, high, sizes }) {
  const row = element("dl", { class: "quantity", "data-key": "layer" });
  const chances = element("span", { class: "range-text" }, text.slice(place.length));
  row.append(element("dt", {}, "Lies"), element("dd", {}, element("b", { class: "number" }, place), chances));
  row.append(range({ low, high, value, from: "gland", to: "fat" }));
  if (sizes) row.append(element("dd", { class: "wide" }, `Diameter ${sizes}`));
  return row;
}

/** What stands in the card before the first stroke: what to do, and what will come. */
function beginning(gone, mode, model, awaited) {
  const box = element("div", { class: "beginning" });
  if (awaited && !gone) {
    box.append(element("p", {}, "The stroke is over. Its answer is on its way."));
    return box;
  }
  if (mode === "replay") box.append(element("p", {}, "Play the recording below, or pick one of its strokes."));
  else if (gone) box.append(element("p", {}, "No stroke yet. The page goes on by itself when the probe is there."));
  else {
    const steps = ["Press the probe on the tissue until Contact lights.", "Stroke over the place with an even force, and 28 mm past it.",
      "Diameter, depth and stiffness of a lump are shown here, each with its interval."];
    box.append(element("p", {}, "No stroke yet."), element("ol", {}, ...steps.map((text) => element("li", {}, text))));
  }
  if (mode === "live" && !gone && model === "") box.append(...noModel());
  return box;
}

function noModel() {
  const button = element("button", { type: "button", class: "main", "data-do": "flash" }, "Put a model on the probe");
  return [element("p", { class: "warning" }, "This probe has no model yet: it feels, and cannot judge."), button];
}

/** What the strokes of a visit over one lump say together, above the card; an empty box where there are fewer than two. */
export function drawVisitAnswer(box, answer, name) {
  box.hidden = !answer;
  if (!answer) return box.replaceChildren();
  const { strokes, left_out: out, level, d_mm: d, depth_mm: depth, hardness } = answer;
  const between = ({ value, low, high }) => `${number(value, "mm")} mm (${number(low, "mm")} to ${number(high, "mm")})`;
  const of = `${name}: ${strokes} strokes over one lump${out ? `, ${out} left out` : ""}`;
  const interval = `${number(d.low, "mm")} to ${number(d.high, "mm")} mm, ${Math.round(level * 100)} % interval`;
  const more = [depth && `${between(depth)} deep`, hardness && `${hardness}, ${answer.stiffness_text}`].filter(Boolean);
  const how = element("details", {}, element("summary", {}, "How"), element("p", {}, answer.how));
  box.replaceChildren(
    element("div", { class: "of" }, element("span", {}, of), how),
    element("p", { class: "hero" }, element("b", { class: "number" }, number(d.value, "mm")), element("span", {}, "mm"), element("span", { class: "range-text" }, interval)),
    element("p", { class: "more" }, ...more.flatMap((text) => [element("span", {}, text), " "])),
  );
}

/** What the forward model says of a stroke, below the probe's own card; null: nobody asks it. */
export function drawRefined(box, refined) {
  box.hidden = !refined;
  if (!refined) return box.replaceChildren();
  if (refined.working) return box.replaceChildren(element("p", { class: "say" }, "Refining: the forward model is fitted to this stroke…"));
  if (refined.problem) return box.replaceChildren(element("p", { class: "say" }, refined.problem));
  const span = (low, high) => (high === null ? `over ${number(low ?? 0, "")}` : `${number(low ?? 0, "")} to ${number(high, "")}`);
  const rows = refined.rows.map(({ key, label, unit, value, low, high }) =>
    element("dl", { class: "quantity", "data-key": key }, element("dt", {}, label),
      element("dd", {}, element("b", { class: "number" }, `${number(value, "")} ${unit}`), " ", element("span", { class: "range-text" }, span(low, high)))));
  const rest = refined.settled ? "" : ", the search had not come to rest";
  box.className = refined.fits ? "" : "doubtful";
  box.replaceChildren(
    element("p", { class: "verdict" }, refined.hardness && refined.hardness !== "unsure" ? `${refined.title}, ${refined.hardness}` : refined.title),
    element("p", { class: "say" }, refined.text),
    ...rows,
    element("p", { class: "foot" }, `Odds: ${refined.odds}. Misfit ${refined.misfit.toFixed(2)}${rest}.`),
  );
}

/** Fill `box` with the card of a stroke, or with what to do while there is none. */
export function drawCard(box, card, { gone = false, mode = "live", model = null, awaited = false, hero = true } = {}) {
  box.replaceChildren();
  box.className = "";
  if (!card) {
    box.append(beginning(gone, mode, model, awaited));
    return;
  }
  box.className = `tone-${card.kind}${card.kind === "outside" ? " doubtful" : ""}`;
  box.append(element("p", { class: "verdict" }, card.title));
  if (card.text) box.append(element("p", { class: "say" }, ...sentence(card.text)));
  if (card.kind === "no_model" && mode === "live" && !gone) box.append(noModel()[1]);
  if (card.reference) box.append(element("p", { class: "say" }, card.reference));
  const sure = card.kind === "lump" || card.kind === "none"; // of other strokes nobody knows how often it holds
  const level = sure && card.level ? `${Math.round(card.level * 100)} % interval` : "interval";
  const rows = card.rows.map((row) => quantity(row, hero && row.key === "d_mm", level));
  if (card.hardness) rows.splice(card.rows.findIndex((row) => row.key === "depth_mm") + 1 || rows.length, 0, stiffness(card));
  if (card.layer) rows.splice(card.rows.findIndex((row) => row.key === "depth_mm") + 1, 0, layer(card.layer));
  box.append(...rows);
  const foot = element("p", { class: "foot" });
  if (sure && card.level && card.rows.length) foot.append(`Each interval holds the truth ${Math.round(card.level * 100)} times in 100. `);
  if (card.model_id) foot.append(`Model ${card.model_id}. `);
  foot.append(element("strong", {}, card.notice));
  box.append(foot);
}
