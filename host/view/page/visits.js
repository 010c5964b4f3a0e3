// The list of strokes, how well they repeat, and two visits side by side.

import { comparison } from "./comparison.js";
import { element, get, toast } from "./dom.js";
import { Held, Plot, extent } from "./plot.js";
import { arrange, head, inSight, item, reveal } from "./stroke_list.js";

const UNITS = { d_mm: "mm", depth_mm: "mm", t_mm: "mm", F_N_per_m: "N/m" };

export class History {
  /** hooks: {ask(command, options), pick(number|null)} */
  constructor(hooks) {
    this.hooks = hooks;
    this.strokes = [];
    this.visits = [];
    this.current = 1;
    this.picked = null;
    this.pair = null; // the visits that the reader chose to compare
    this.choices = 0; // counts those choices
    this.items = new Map(); // the list's nodes: what stands there stays, also under a finger that is just pressing it
    this.pressed = null;
    this.plot = new Plot(get("repeat"), { xLabel: "strokes of this visit, oldest first", yLabel: "mm", counts: true });
    this.axes = new Held();
    // A new stroke may move the list while a finger is down: the one that was pressed is meant.
    get("strokes").addEventListener("pointerdown", ({ target }) => {
      this.pressed = target.closest("[data-number]");
    });
    get("strokes").addEventListener("click", ({ detail, target }) => {
      const item = (detail && this.pressed) || target.closest("[data-number]"); // a screen reader's click has no detail
      if (item) hooks.pick(Number(item.dataset.number));
    });
    for (const name of ["quantity", "last"]) get(name).addEventListener("change", () => this.refresh());
    for (const name of ["visit-a", "visit-b"]) {
      get(name).addEventListener("change", () => {
        this.choose(get("visit-a").value, get("visit-b").value);
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

  /** Another viewer program answers now: its strokes and visits are others. */
  forget() {
    this.items.clear();
    this.axes.forget();
    this.pair = null;
    this.choices += 1;
  }

  choose(earlier, later) {
    this.pair = [Number(earlier), Number(later)];
    this.choices += 1;
  }

  /** Scroll the list so that the picked stroke can be seen. */
  keepInSight() {
    const box = get("strokes");
    const line = box.querySelector('[aria-selected="true"]');
    if (line) reveal(box, line);
  }

  mark(number) {
    if (number === this.picked) return;
    this.picked = number;
    const box = get("strokes");
    box.removeAttribute("aria-activedescendant");
    for (const item of box.querySelectorAll("[data-number]")) {
      const on = Number(item.dataset.number) === number;
      item.setAttribute("aria-selected", on);
      if (!on) continue;
      reveal(box, item);
      box.setAttribute("aria-activedescendant", item.id);
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

  /** Newest first, a head over each visit's. */
  list() {
    const nodes = new Map();
    const add = (key, make) => nodes.set(key, this.items.get(key) ?? make());
    const visits = new Map(this.visits.map((v) => [v.number, v.name]));
    for (let n = this.strokes.length - 1, first = n; n >= 0; n = first - 1) {
      const { visit } = this.strokes[n];
      for (first = n; this.strokes[first - 1]?.visit === visit; first--);
      add(`visit ${visit} from ${this.strokes[first].number}`, () => head(visits.get(visit) ?? ""));
      for (let i = n; i >= first; i--) add(this.strokes[i].number, () => item(this.strokes[i], this.picked));
    }
    if (!nodes.size) add("none", () => head("Strokes are listed here as they end."));
    this.items = nodes;
    const box = get("strokes");
    const picked = box.querySelector('[aria-selected="true"]');
    const seen = picked && inSight(box, picked);
    arrange(box, [...nodes.values()]);
    if (seen) this.keepInSight(); // those that come push it down; a reader who has scrolled elsewhere stays there
    const n = this.strokes.length;
    get("history-note").textContent = n ? `${n} so far; pick one to see it again` : "";
  }

  fillVisits() {
    const [a, b] = [get("visit-a"), get("visit-b")];
    for (const select of [a, b]) {
      const same = this.visits.length === select.length && this.visits.every((v, i) => v.name === select[i].text);
      if (!same) select.replaceChildren(...this.visits.map((v) => new Option(v.name, v.number))); // one may be open
    }
    const earlier = this.visits.filter((v) => v.number !== this.current).at(-1)?.number ?? this.current;
    [a.value, b.value] = this.pair ?? [earlier, this.current];
  }

  async refresh() {
    const last = Math.min(Math.max(Number(get("last").value) || 5, 2), 100);
    const turn = (this.refreshed = (this.refreshed ?? 0) + 1);
    let spread;
    try {
      spread = await this.hooks.ask("repeatability", { visit: this.current, last });
    } catch {
      return; // the connection is gone, which the page says; this is asked again when it is back
    }
    if (turn !== this.refreshed) return; // asked again since: that answer knows more
    this.spread = spread;
    this.draw();
    await this.compare();
  }

  draw() {
    const key = get("quantity").value;
    const unit = UNITS[key];
    const shown = this.strokes.filter((s) => s.visit === this.current && s.card.kind === "lump").slice(-24);
    const items = shown.map((stroke, i) => {
      const row = stroke.card.rows.find((r) => r.key === key);
      const used = this.spread?.used.includes(stroke.number);
      return row && { x: i, ...row, key: stroke.number, paint: used ? "points" : "ghost" };
    });
    const found = this.spread?.visit === this.current ? this.spread[key] : null;
    const wanted = extent([items.flatMap((i) => (i ? [i.low, i.high] : []))], key === "F_N_per_m" ? [0, 120] : [0, 20], 0.05, 1);
    const y = items.length ? this.axes.range(this.current, key, wanted) : wanted;
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
    get("repeat-text").textContent = sentence(found, unit);
  }

  shownPair() {
    return [Number(get("visit-a").value), Number(get("visit-b").value)];
  }

  async compare() {
    const turn = (this.compared = (this.compared ?? 0) + 1);
    const [a, b] = this.shownPair();
    const box = get("comparison");
    if (!a || !b || a === b) {
      box.innerHTML = `<p class="say">Begin a new visit, or load an earlier recording, to see whether the lump has grown by more than strokes differ among themselves.</p>`;
      return;
    }
    let shown;
    try {
      shown = comparison(await this.hooks.ask("compare", { a, b }));
    } catch (error) {
      shown = [error.message];
    }
    if (turn !== this.compared) return; // others have been chosen, or an answer that knows more is on its way
    refill(box, shown);
  }

  async openLoad() {
    const list = get("load-list");
    list.textContent = "Looking into the recordings folder.";
    get("dialog-load").showModal();
    let files;
    try {
      ({ files } = await this.hooks.ask("recordings"));
    } catch (error) {
      list.textContent = error.message;
      return;
    }
    list.replaceChildren(
      ...files.map((file) => {
        const button = element("button", {}, file);
        button.addEventListener("click", () => this.load(file));
        return element("li", {}, button);
      }),
    );
    if (!files.length) list.textContent = "The recordings folder is empty. Record a visit first (R).";
  }

  async load(file) {
    get("dialog-load").close();
    const choices = ++this.choices;
    toast(`Reading ${file}.`);
    try {
      const { visit, strokes } = await this.hooks.ask("load-visit", { file });
      if (choices === this.choices) {
        this.choose(visit, this.current); // the list of visits may come before this answer or after it
        this.fillVisits();
        await this.compare();
      }
      toast(`${file}: ${strokes} ${strokes === 1 ? "stroke" : "strokes"} loaded.`);
    } catch (error) {
      toast(error.message);
    }
  }
}

/** Shows nodes in a box whose details somebody may be reading, or just opening: that element and its summary stay. */
function refill(box, nodes) {
  const at = nodes.findIndex((one) => one.tagName === "DETAILS");
  const kept = box.querySelector(":scope > details");
  if (at < 0 || !kept) return box.replaceChildren(...nodes);
  for (const one of [...box.children]) if (one !== kept) one.remove();
  kept.before(...nodes.slice(0, at));
  kept.after(...nodes.slice(at + 1));
  for (const one of [...kept.children].slice(1)) one.remove();
  kept.append(...[...nodes[at].children].slice(1));
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
