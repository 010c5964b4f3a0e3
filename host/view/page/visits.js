// The list of strokes, how well they repeat, and two visits side by side.

import { Plot, extent } from "./plot.js";

const UNITS = { d_mm: "mm", depth_mm: "mm", t_mm: "mm", F_N_per_m: "N/m" };
const NAMES = { d_mm: "Diameter", depth_mm: "Depth", t_mm: "Thickness", F_N_per_m: "Force, N/m" };

export class History {
  /** hooks: {ask(command, options), pick(number|null), toast(text)} */
  constructor(get, hooks) {
    this.get = get;
    this.hooks = hooks;
    this.strokes = [];
    this.visits = [];
    this.current = 1;
    this.picked = null;
    this.pair = null;
    this.plot = new Plot(get("repeat"), { xLabel: "", yLabel: "mm" });
    get("strokes").addEventListener("click", (event) => {
      const item = event.target.closest("[data-number]");
      if (item) hooks.pick(Number(item.dataset.number));
    });
    for (const name of ["quantity", "last"]) get(name).addEventListener("change", () => this.refresh());
    for (const name of ["visit-a", "visit-b"]) {
      get(name).addEventListener("change", () => {
        this.pair = [get("visit-a").value, get("visit-b").value];
        this.compare();
      });
    }
    get("load-visit").addEventListener("click", () => this.openLoad());
  }

  set({ strokes, visits, current_visit: current }) {
    Object.assign(this, { strokes, visits, current });
    this.list();
    this.fillVisits();
    this.refresh();
  }

  mark(number) {
    this.picked = number;
    for (const item of this.get("strokes").querySelectorAll("[data-number]")) {
      const on = Number(item.dataset.number) === number;
      item.setAttribute("aria-selected", on);
      if (on) {
        item.scrollIntoView({ block: "nearest" });
        this.get("strokes").setAttribute("aria-activedescendant", item.id);
      }
    }
    this.draw();
  }

  /** The neighbour of the picked stroke (step -1: earlier), or the newest. */
  neighbour(step) {
    const order = this.strokes.map((s) => s.number);
    if (!order.length) return null;
    const at = order.indexOf(this.picked);
    if (at < 0) return order.at(-1);
    return order[at + step] ?? null;
  }

  list() {
    const box = this.get("strokes");
    const items = [];
    let visit = null;
    for (const stroke of [...this.strokes].reverse()) {
      if (stroke.visit !== visit) {
        visit = stroke.visit;
        const head = document.createElement("li");
        head.className = "visit";
        head.setAttribute("role", "presentation");
        head.textContent = this.visits.find((v) => v.number === visit)?.name ?? "";
        items.push(head);
      }
      items.push(this.item(stroke));
    }
    box.replaceChildren(...items);
    if (!items.length) box.innerHTML = '<li class="visit" role="presentation">Strokes are listed here as they end.</li>';
    const n = this.strokes.length;
    this.get("history-note").textContent = n ? `${n} so far; pick one to see it again` : "";
    if (this.picked !== null) this.mark(this.picked);
  }

  item(stroke) {
    const { card } = stroke;
    const item = document.createElement("li");
    item.id = `stroke-${stroke.number}`;
    item.dataset.number = stroke.number;
    item.setAttribute("role", "option");
    item.setAttribute("aria-selected", "false");
    const row = card.rows.find((r) => r.key === "d_mm");
    const parts = [
      ["n", `${stroke.number}`],
      ["what", card.title],
      ["when", new Date(stroke.wall_time * 1000).toLocaleTimeString([], { hour12: false })],
      ["size", row && card.kind === "lump" ? `${row.value.toFixed(1)} mm` : ""],
      [`tag ${card.hardness ?? ""}`, card.kind === "lump" ? card.hardness : ""],
    ];
    for (const [name, text] of parts) {
      const span = document.createElement("span");
      span.className = name;
      span.textContent = text;
      item.append(span);
    }
    return item;
  }

  fillVisits() {
    const [a, b] = [this.get("visit-a"), this.get("visit-b")];
    for (const select of [a, b]) {
      select.replaceChildren(...this.visits.map((v) => new Option(v.name, v.number)));
    }
    const earlier = this.visits.filter((v) => v.number !== this.current).at(-1)?.number ?? this.current;
    [a.value, b.value] = this.pair ?? [earlier, this.current];
  }

  async refresh() {
    const last = Math.min(Math.max(Number(this.get("last").value) || 5, 2), 100);
    try {
      this.spread = await this.hooks.ask("repeatability", { visit: this.current, last });
    } catch {
      return;
    }
    this.draw();
    await this.compare();
  }

  draw() {
    const key = this.get("quantity").value;
    const unit = UNITS[key];
    const shown = this.strokes.filter((s) => s.visit === this.current && s.card.kind === "lump").slice(-24);
    const items = shown.map((stroke, i) => {
      const row = stroke.card.rows.find((r) => r.key === key);
      const used = this.spread?.used.includes(stroke.number);
      return row && { x: i, ...row, key: stroke.number, paint: used ? "points" : "ghost" };
    });
    const found = this.spread?.[key];
    const y = extent([items.flatMap((i) => (i ? [i.low, i.high] : []))], key === "F_N_per_m" ? [0, 120] : [0, 20], 0.12, 1);
    this.plot.yLabel = unit;
    this.plot.draw(
      [
        found?.sd && { kind: "belt", from: found.mean - found.sd, to: found.mean + found.sd },
        found && { kind: "level", at: found.mean, color: "accent", dash: [] },
        { kind: "bars", items: items.filter(Boolean), picked: this.picked },
      ],
      [-0.7, Math.max(items.length, 6) - 0.3],
      y,
    );
    this.get("repeat-text").textContent = sentence(found, unit);
  }

  async compare() {
    const [a, b] = [Number(this.get("visit-a").value), Number(this.get("visit-b").value)];
    const box = this.get("comparison");
    if (!a || !b || a === b) {
      box.innerHTML = `<p class="say">Begin a new visit, or load an earlier recording, to see whether the lump has grown by more than strokes differ among themselves.</p>`;
      return;
    }
    let found;
    try {
      found = await this.hooks.ask("compare", { a, b });
    } catch (error) {
      box.textContent = error.message;
      return;
    }
    box.replaceChildren(...comparison(found));
  }

  async openLoad() {
    const list = this.get("load-list");
    let files;
    try {
      ({ files } = await this.hooks.ask("recordings"));
    } catch (error) {
      this.hooks.toast(error.message);
      return;
    }
    list.replaceChildren(
      ...files.map((file) => {
        const button = document.createElement("button");
        button.textContent = file;
        button.addEventListener("click", () => this.load(file));
        const item = document.createElement("li");
        item.append(button);
        return item;
      }),
    );
    if (!files.length) list.textContent = "The recordings folder is empty. Record a visit first (R).";
    this.get("dialog-load").showModal();
  }

  async load(file) {
    this.get("dialog-load").close();
    try {
      const { visit, strokes } = await this.hooks.ask("load-visit", { file });
      this.pair = [visit, this.current]; // the list of visits may come before this answer or after it
      this.fillVisits();
      await this.compare();
      this.hooks.toast(`${file}: ${strokes} ${strokes === 1 ? "stroke" : "strokes"} loaded.`);
    } catch (error) {
      this.hooks.toast(error.message);
    }
  }
}

function sentence(found, unit) {
  if (!found) return "Mean and spread of the last strokes will stand here.";
  const digits = unit === "N/m" ? 0 : 1;
  if (found.sd === null) return `${found.mean.toFixed(digits)} ${unit} from one stroke; stroke again to see how well it repeats.`;
  return (
    `${found.mean.toFixed(digits)} ${unit}, spread (sd) ${found.sd.toFixed(2)} ${unit} over ${found.n} strokes. ` +
    `Two strokes agree within ${found.repeatability.toFixed(2)} ${unit}, 95 times in 100.`
  );
}

function comparison(found) {
  const result = document.createElement("p");
  const main = found.d_mm;
  result.className = `result${main?.beyond ? " beyond" : ""}`;
  result.textContent = main?.text ?? "One of the visits holds no stroke with a diameter yet.";
  if (!main) return [result];
  const table = document.createElement("table");
  table.innerHTML = "<thead><tr><th>mm</th><th>earlier</th><th>later</th><th>change (95 %)</th></tr></thead>";
  const body = table.createTBody();
  for (const [key, name] of Object.entries(NAMES)) {
    const row = found[key];
    if (!row) continue;
    const mean = ({ mean, sd }) => (sd === null ? mean.toFixed(1) : `${mean.toFixed(1)} ± ${sd.toFixed(1)}`);
    const sure = row.change_low === null ? "" : ` (${row.change_low.toFixed(1)} to ${row.change_high.toFixed(1)})`;
    const line = body.insertRow();
    for (const text of [`${name}`, mean(row.a), mean(row.b), `${row.change.toFixed(1)}${sure}`]) {
      line.insertCell().textContent = text;
    }
  }
  return [result, table];
}
