// The estimate card: words and numbers from the server, an interval bar for each number.

const SPANS = { d_mm: 30, depth_mm: 30, t_mm: 40, F_N_per_m: 150 };

const number = (v, unit) => (unit === "N/m" ? v.toFixed(0) : v.toFixed(1));

function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

function range(low, high, value, divider) {
  const bar = element("div", { class: "range", "aria-hidden": "true" });
  const place = (share) => `${(100 * Math.min(Math.max(share, 0), 1)).toFixed(1)}%`;
  const band = element("i");
  band.style.left = place(low);
  band.style.right = place(1 - high);
  bar.append(band);
  if (divider !== undefined) {
    const line = element("u");
    line.style.left = place(divider);
    bar.append(line);
  }
  if (value !== null) {
    const tick = element("b");
    tick.style.left = place(value);
    bar.append(tick);
  }
  return bar;
}

function quantity({ key, label, unit, value, low, high }, hero) {
  const span = Math.max(SPANS[key] ?? high, high * 1.05);
  const row = element("dl", { class: hero ? "quantity first" : "quantity", "data-key": key });
  row.append(element("dt", {}, label));
  if (hero) {
    row.append(element("dd", { class: "hero" }, element("b", { class: "number" }, number(value, unit)), element("span", {}, unit)));
  } else row.append(element("dd", { class: "number" }, `${number(value, unit)} ${unit}`));
  const text = `${number(low, unit)} to ${number(high, unit)}`;
  row.append(element("dd", { class: "between" }, range(low / span, high / span, value / span), element("span", { class: "range-text" }, text)));
  return row;
}

function stiffness({ hardness, hardness_text: words, E_ratio: ratio }) {
  const row = element("dl", { class: "quantity", "data-key": "stiffness" });
  row.append(element("dt", {}, "Stiffness"), element("dd", { class: "number" }, hardness));
  row.title = words;
  if (ratio) {
    const share = (e) => Math.log10(e) / 3; // 1 to 1000 times fat
    const low = ratio.low ?? 1;
    const high = ratio.high === null ? 1 : share(ratio.high);
    const bound = (e) => (e >= 100 ? e.toFixed(0) : e.toPrecision(2));
    const value = ratio.high === null || ratio.value === null ? null : share(ratio.value);
    const text = ratio.high === null ? `over ${bound(low)} × fat` : `${bound(low)} to ${bound(ratio.high)} × fat`;
    row.append(element("dd", { class: "between" }, range(share(low), high, value, share(10)), element("span", { class: "range-text" }, text)));
  }
  return row;
}

/** Fill `box` with the card of a stroke, or with what to do while there is none. */
export function drawCard(box, card, gone) {
  box.replaceChildren();
  box.className = "";
  if (!card) {
    const say = gone ? "No stroke yet." : "No stroke yet. Press the probe on the tissue and stroke over the place.";
    box.append(element("p", { class: "empty" }, say));
    return;
  }
  box.className = `tone-${card.kind}${card.kind === "outside" ? " doubtful" : ""}`;
  box.append(element("p", { class: "verdict" }, card.title));
  if (card.text) box.append(element("p", { class: "say" }, card.text));
  const rows = card.rows.map((row) => quantity(row, row.key === "d_mm"));
  if (card.hardness) rows.splice(Math.min(2, rows.length), 0, stiffness(card));
  box.append(...rows);
  const foot = element("p", { class: "foot" });
  const sure = card.kind === "lump" || card.kind === "none"; // of other strokes nobody knows how often it holds
  if (sure && card.level && card.rows.length) foot.append(`Each interval holds the truth ${Math.round(card.level * 100)} times in 100. `);
  if (card.model_id) foot.append(`Model ${card.model_id}. `);
  foot.append(element("strong", {}, card.notice));
  box.append(foot);
}
