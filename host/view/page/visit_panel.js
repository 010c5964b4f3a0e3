// The panel with the map of the visit: it takes the place of the charts; here the operator says where strokes go.

import { element, fetched, get, save, toast } from "./dom.js";
import { prepare } from "./plot.js";
import { reveal, show } from "./stroke_list.js";
import { color } from "./theme.js";
import { MOST_ARRANGED, described, told } from "./visit_map.js";
import { drawVisit } from "./visit_picture.js";

const NOT_TOLD = "No lanes were told: the strokes stand side by side in their order, not where they were.";
const onlyNewest = (n) => ` The newest ${MOST_ARRANGED} of ${n} are drawn; the list has all.`;
const leftOut = (n) => `${n} ${n === 1 ? "stroke" : "strokes"} without a lane ${n === 1 ? "is" : "are"} left out.`;
const NONE_YET = "Strokes appear here as they end, each in its lane.";
const PICTURE = [1200, 800];

export class VisitPanel {
  /** hooks: {ask(command, options), pick(number), redraw()} */
  constructor({ image, history, page }, hooks) {
    Object.assign(this, { image, history, page, hooks });
    this.strips = new Map(); // by stroke: a strip never changes
    this.asked = new Map(); // by stroke: the promise of its strip
    this.lanes = null;
    this.waits = 0; // settings on their way: until they are answered the fields show what was typed
    this.sessions = 0; // counts viewer programs: what one has told is not another's
    get("visit-map-button").addEventListener("click", () => this.toggle());
    get("export-visit-map").addEventListener("click", () => this.save());
    get("visit-map").addEventListener("click", (event) => this.hit(event));
    get("visit-map-list").addEventListener("click", ({ target }) => {
      const line = target.closest("[data-number]");
      if (line) hooks.pick(Number(line.dataset.number));
    });
    get("lanes-told").addEventListener("change", () => this.setLanes(get("lanes-told").checked));
    for (const id of ["lane-next", "lane-step"]) get(id).addEventListener("change", () => this.setLanes(true));
    new ResizeObserver(hooks.redraw).observe(get("visit-map")); // else a click would count on a picture stretched to its new size
  }

  get open() {
    return document.body.dataset.view === "visit";
  }

  toggle() {
    if (this.open) delete document.body.dataset.view;
    else document.body.dataset.view = "visit";
    get("visit-map-button").setAttribute("aria-pressed", this.open);
    get("visit-map-button").classList.toggle("on", this.open);
    if (this.open) show(get("visit-map").closest(".panel"));
    this.hooks.redraw();
  }

  /** Another viewer program answers now. */
  forget() {
    this.sessions += 1;
    this.strips.clear();
    this.asked.clear();
    this.lanes = null;
  }

  // ---- lanes

  /** Where the next stroke goes, as the viewer program tells it; an older state does not undo a newer. */
  setKnown(lanes) {
    if (!lanes || (this.lanes && lanes.changes < this.lanes.changes)) return;
    this.lanes = lanes;
    if (!this.waits) this.fields();
    this.hooks.redraw();
  }

  /** What is being typed stays. */
  fields() {
    get("lanes-told").checked = this.lanes.told;
    for (const [id, key] of [["lane-next", "next_mm"], ["lane-step", "step_mm"]]) {
      const field = get(id);
      const typing = field === document.activeElement && field.value !== field.dataset.shown;
      if (!typing) field.value = field.dataset.shown = `${this.lanes[key]}`;
    }
  }

  async setLanes(told) {
    const fields = ["lane-next", "lane-step"].map((id) => get(id));
    for (const field of fields) field.dataset.shown = field.value; // no longer typed, but told
    const [next, step] = fields.map((field) => field.valueAsNumber);
    if (!Number.isFinite(next) || !Number.isFinite(step)) return this.lanes && this.fields();
    this.waits += 1;
    try {
      const { lanes } = await this.hooks.ask("lanes", { told, next_mm: next, step_mm: step });
      this.waits -= 1;
      this.setKnown(lanes);
    } catch (error) {
      this.waits -= 1;
      toast(error.message);
    }
    if (!this.waits && this.lanes) this.fields();
  }

  // ---- the map

  /** The visit of the picked stroke, or the one that strokes go to. */
  get visit() {
    const { strokes, picked, current } = this.history;
    return strokes.find((s) => s.number === picked)?.visit ?? current;
  }

  get name() {
    return this.history.visits.find((v) => v.number === this.visit)?.name ?? "";
  }

  /** Its strokes, each with its strip as far as that has come. */
  shown() {
    const { visit } = this;
    return this.history.strokes.filter((s) => s.visit === visit).map((s) => ({ ...s, strip: this.strips.get(s.number) ?? null }));
  }

  /** Has the operator said where strokes of this visit lie? */
  byLanes(strokes) {
    return told(strokes).length > 0;
  }

  draw() {
    if (!this.open) return;
    const strokes = this.shown();
    this.fetch(strokes);
    const { picked, current } = this.history;
    const table = this.image.tables[this.image.name];
    this.describe(strokes); // first: the words take room from the map
    const canvas = get("visit-map");
    const { context, width, height } = prepare(canvas);
    const running = this.page.running?.visit === this.visit ? this.page.running : null;
    const live = document.body.dataset.mode === "live" && this.visit === current;
    const next_mm = live && this.lanes?.told ? this.lanes.next_mm : null;
    const byLanes = this.byLanes(strokes);
    this.place = table ? drawVisit(context, width, height, { strokes, byLanes, table, picked, next_mm, running }) : null;
    canvas.dataset.strips = strokes.filter((s) => s.strip).map((s) => s.number).join(" ");
    canvas.dataset.drawn = JSON.stringify(this.place?.strips ?? []);
    canvas.dataset.shapes = JSON.stringify(this.place?.shapes ?? []);
    canvas.dataset.labels = JSON.stringify(this.place?.labels ?? []);
    canvas.dataset.words = JSON.stringify(this.place?.words ?? []);
    canvas.dataset.top = this.place?.top ?? "";
  }

  /** What must be said of where the strokes stand. */
  remark(strokes) {
    if (!strokes.length) return NONE_YET;
    if (!this.byLanes(strokes)) return NOT_TOLD + (strokes.length > MOST_ARRANGED ? onlyNewest(strokes.length) : "");
    const without = strokes.length - told(strokes).length;
    return without ? leftOut(without) : "";
  }

  describe(strokes) {
    get("visit-map-note").textContent = this.name;
    get("visit-map-order").textContent = this.remark(strokes);
    const lines = strokes.map(described);
    const key = JSON.stringify([lines, this.history.picked]);
    if (key !== this.listed) {
      this.listed = key;
      const list = get("visit-map-list");
      list.replaceChildren(
        ...strokes
          .map(({ number }, n) => element("li", { "data-number": number, ...(number === this.history.picked && { "aria-current": "true" }) }, lines[n]))
          .reverse(), // as in the list of strokes
      );
      const line = list.querySelector("[aria-current]");
      if (line) reveal(list, line);
    }
    get("visit-map").setAttribute("aria-label", `Map of the visit, ${strokes.length} ${strokes.length === 1 ? "stroke" : "strokes"}; the list below says what is on it`);
  }

  /** Ask for the strips that are not here yet, each once; where no answer comes, again with the next drawing. */
  fetch(strokes) {
    for (const { number } of strokes) if (!this.asked.has(number)) this.asked.set(number, this.fetchOne(number));
    return Promise.all(strokes.map(({ number }) => this.asked.get(number)));
  }

  async fetchOne(number) {
    const { sessions } = this;
    const strip = await fetched(`/api/strip-${number}.json`);
    if (sessions !== this.sessions) return;
    if (!strip) return this.asked.delete(number);
    this.strips.set(number, strip);
    this.hooks.redraw();
  }

  /** A click on a strip picks its stroke; where several lie there, the one whose middle is nearest, and the newest of those. */
  hit({ offsetX: x, offsetY: y }) {
    const under = this.place?.strips.filter((s) => s.left <= x && x <= s.right && s.top <= y && y <= s.bottom) ?? [];
    const off = ({ left, right }) => Math.abs((left + right) / 2 - x);
    const [nearest] = under.sort((a, b) => off(a) - off(b) || b.number - a.number);
    if (nearest) this.hooks.pick(nearest.number);
  }

  // ---- a picture to take away

  async save() {
    get("export").open = false;
    await this.image.loadColors().catch(() => {});
    await this.fetch(this.shown());
    const strokes = this.shown();
    const table = this.image.tables[this.image.name];
    const [width, height] = PICTURE;
    const canvas = element("canvas", { width, height });
    const c = canvas.getContext("2d");
    c.fillStyle = color("panel");
    c.fillRect(0, 0, width, height);
    if (!table || !drawVisit(c, width, height - 70, { strokes, byLanes: this.byLanes(strokes), table })) return toast("There is no stroke to map yet.");
    const models = [...new Set(strokes.map((s) => s.card.model_id).filter(Boolean))].join(", ");
    c.fillStyle = color("text");
    c.textAlign = "left";
    c.textBaseline = "top";
    c.fillText(`${this.name}. ${this.remark(strokes)}`, 24, height - 52);
    c.fillText(`Model ${models || "none"}. ${strokes[0].card.notice}`, 24, height - 30);
    save(canvas, `visit-${this.visit}.png`);
  }
}
