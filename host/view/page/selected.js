// Which stroke the page shows: the running one (or the last), or one that was picked from the list.

import { CELLS } from "./array.js";
import { drawCard, drawRefined, drawVisitAnswer } from "./card.js";
import { fetched, get, timeOf, toast } from "./dom.js";
import { Fitted } from "./fitted.js";
import { nearest } from "./plot.js";
import { show } from "./stroke_list.js";

export class Selected {
  constructor({ image, charts, history, page, redraw }) {
    Object.assign(this, { image, charts, history, page, redraw });
    this.fitted = new Fitted(get("fitted"));
    this.picked = null;
    this.last = null;
    this.place = null;
    this.wanted = null; // the stroke that somebody has picked, be it on its way still
    this.choice = 0; // counts what was picked: of several strokes on their way the last one counts
    this.news = 0; // counts what was told of the last stroke
    this.after = null; // {stroke, lifted}: it has just ended; until the probe touches again its lump is shown
    get("back-live").addEventListener("click", () => this.back());
    get("scrub-range").addEventListener("input", () => this.scrub(Number(get("scrub-range").value)));
  }

  /** The page has just been told everything; `number` is the last stroke, or null. */
  async start(number) {
    const news = ++this.news;
    const stroke = number === null ? null : await fetched(`/api/stroke-${number}.json`);
    if (news !== this.news || !stroke) return; // a stroke that has ended meanwhile is newer
    this.last = stroke;
    if (this.image.resting && document.body.dataset.mode === "live") this.ended(stroke);
    this.showLast();
    this.showNow();
  }

  /** Another viewer program answers now: its strokes are others. */
  forget() {
    this.back();
    this.last = this.after = null;
    this.news += 1;
    this.charts.forget();
    this.image.base = null;
    this.card(null);
    this.exports(null);
  }

  /** The image over the lump waits for the probe to be lifted off. */
  ended(stroke) {
    const over = stroke.lump && stroke.over_lump;
    this.after = {
      stroke,
      lifted: this.image.resting,
      over: over && { position_mm: over.position_mm, pressure: Float32Array.from(over.pressure_kPa) },
    };
  }

  note(text) {
    if (get("image-note").textContent !== text) get("image-note").textContent = text;
  }

  /** The probe has touched the tissue, begun a stroke or been lifted. */
  touched({ contact, stroke }) {
    if (!this.last && !this.picked) this.card(null);
    if (!this.after) return;
    if (stroke || (contact && this.after.lifted)) this.after = null;
    else if (!contact) this.after.lifted = true;
    this.showNow();
  }

  /** Somebody has moved along the recording. */
  jumped() {
    this.after = null;
    this.showNow();
  }

  /** What is felt now; or, with the probe lifted off after a stroke, the image over its lump. */
  showNow() {
    if (this.picked || this.page.held) return;
    const { after, image, page } = this;
    const over = after?.lifted ? after.over : null;
    const position_mm = over?.position_mm ?? page.frame?.position_mm;
    image.lump = after?.stroke.lump && Number.isFinite(position_mm) ? { lump: after.stroke.lump, position_mm } : null;
    if (image.picked !== Boolean(over)) image.turn();
    image.picked = Boolean(over);
    if (over) image.base = after.stroke.base;
    this.note(over ? `stroke ${after.stroke.number}` : "");
    const pressure = over ? over.pressure : page.frame?.pressure;
    if (pressure) image.draw(pressure);
  }

  /** Where a recording has been played to its end the page rests on its last stroke, until it plays again. */
  linkChanged(state) {
    if (state === "ended" && this.wanted === null) {
      this.rests = true;
      this.pick(this.history.strokes.at(-1)?.number ?? null);
    } else if (state !== "ended" && this.rests) {
      this.after = null;
      this.back();
    }
    if (!this.last && !this.picked) this.card(null);
  }

  /** A stroke has just ended. */
  finished(stroke) {
    this.news += 1;
    this.last = stroke;
    this.ended(stroke);
    this.showLast();
    this.showNow();
  }

  /** The last stroke, unless there is none, another is picked, or the picture is held still. */
  showLast() {
    if (!this.last || this.picked || this.page.held) return;
    if (!this.page.running) this.charts.show(this.last);
    this.card(this.last);
    this.redraw();
  }

  async pick(number) {
    if (number === null) return;
    this.rests &&= number === this.history.strokes.at(-1)?.number;
    const choice = ++this.choice;
    this.markPicked(number);
    const stroke = await fetched(`/api/stroke-${number}.json`);
    if (choice !== this.choice) return;
    if (!stroke) {
      this.markPicked(this.picked?.number ?? null);
      toast(`Stroke ${number} cannot be had now.`);
      return;
    }
    this.picked = stroke;
    this.charts.show(stroke);
    this.card(stroke);
    this.images = unpackImages(stroke.images);
    this.image.base = stroke.base;
    this.image.turn();
    const range = get("scrub-range");
    document.body.dataset.picked = number;
    range.max = Math.max(this.images.length - 1, 0);
    get("scrub").hidden = this.images.length < 2;
    if (this.images.length) this.scrub(this.images.reduce((best, i, n) => (i.peak > this.images[best].peak ? n : best), 0));
    this.history.keepInSight(); // the button and the slider have taken room from the list
    show(get("image").closest(".panel"));
    this.redraw();
  }

  back() {
    this.choice += 1; // also one that is still on its way
    this.rests = false;
    this.markPicked(null);
    if (!this.picked) return;
    this.picked = null;
    this.place = null;
    this.image.picked = false;
    this.image.base = (this.page.running ?? this.last)?.base ?? null;
    this.image.turn();
    get("scrub").hidden = true;
    delete document.body.dataset.picked;
    this.charts.show(this.page.running ?? this.last);
    if (this.last) this.card(this.last);
    this.note("");
    this.showNow();
    this.redraw();
  }

  /** In the list, at once; the stroke itself may take a moment. */
  markPicked(number) {
    this.wanted = number;
    get("back-live").hidden = number === null;
    get("back-live").textContent = document.body.dataset.mode === "live" ? "Back to live (Esc)" : "Back (Esc)";
    this.history.mark(number);
  }

  scrub(index) {
    const shown = this.images[index];
    if (!shown) return;
    get("scrub-range").value = index;
    get("scrub-text").textContent = `At ${shown.position_mm.toFixed(1)} mm`;
    this.note(`stroke ${this.picked.number}`);
    document.body.dataset.picked = this.picked.number;
    this.place = shown.position_mm;
    this.readouts(shown);
    this.image.picked = true;
    this.image.lump = this.picked.lump && { lump: this.picked.lump, position_mm: shown.position_mm };
    this.image.draw(shown.pressure);
    this.page.chartsNew = true;
  }

  /** Force and displacement where the picked stroke's image was taken. */
  readouts({ position_mm, peak }) {
    const { position_mm: places, force_N_per_m: forces, displacement_mm: depths } = this.picked.traces;
    const here = nearest(places, position_mm);
    readouts({ force: forces[here], displacement_mm: depths[here], position_mm, peak_kPa: peak });
  }

  /** The pointer over a chart moves along the picked stroke; null: it has left. */
  hover(at) {
    if (at === null || !this.picked || !this.images.length) return;
    this.scrub(nearest(this.images.map(({ position_mm }) => position_mm), at));
  }

  /** Another stroke has joined a visit: its answer may be another. */
  visitsChanged() {
    const shown = this.picked ?? this.last;
    if (shown) this.card(shown);
  }

  /** The forward model has begun with a stroke, or has fitted it. */
  refined(number, refined) {
    for (const stroke of new Set([this.picked, this.last])) if (stroke?.number === number) stroke.refined = refined;
    if ((this.picked ?? this.last)?.number === number) this.visitsChanged();
  }

  card(stroke) {
    const { mode } = document.body.dataset;
    const visit = this.history.visits.find(({ number }) => number === (stroke?.visit ?? null));
    const answer = visit?.answer?.numbers.includes(stroke.number) ? visit.answer : null;
    drawVisitAnswer(get("visit-answer"), answer, visit?.name.endsWith(".mcap") ? "This recording" : visit?.name);
    drawCard(get("card"), stroke?.card, { gone: this.page.link !== "connected", mode, model: this.page.model, awaited: this.page.awaited, hero: !answer });
    drawRefined(get("refined"), stroke?.refined);
    this.fitted.show(stroke?.refined?.laid ?? null);
    if (!stroke) {
      get("estimate-which").textContent = "";
      return;
    }
    const lost = stroke.gaps ? `, ${stroke.gaps} frames lost` : "";
    this.exports(stroke.number);
    get("estimate-which").textContent = `stroke ${stroke.number}, ${timeOf(stroke.wall_time)}${lost}`;
  }

  /** The export menu takes the stroke that is shown; null: there is none. */
  exports(number) {
    for (const kind of ["png", "svg", "csv", "json"]) {
      const link = get(`export-${kind}`);
      if (number === null) {
        link.removeAttribute("href");
        link.setAttribute("aria-disabled", true);
        continue;
      }
      link.href = `/api/stroke-${number}.${kind}`;
      link.download = `stroke-${number}.${kind}`;
      link.removeAttribute("aria-disabled");
    }
  }
}

/** The numbers below the image; what is not known is a dash. */
export function readouts({ force, displacement_mm, position_mm, peak_kPa }) {
  const shown = [["force", force, 0], ["displacement", displacement_mm, 2], ["position", position_mm, 1], ["peak", peak_kPa, 1]];
  for (const [id, value, digits] of shown) get(`now-${id}`).textContent = Number.isFinite(value) ? value.toFixed(digits) : "–";
}

function unpackImages({ position_mm: positions, step_kPa: step, peak_kPa: peaks, uint16 }) {
  const bytes = Uint8Array.from(atob(uint16), (ch) => ch.charCodeAt(0));
  const all = new Uint16Array(bytes.buffer);
  return positions.map((position_mm, n) => {
    const pressure = Float32Array.from(all.subarray(n * CELLS, (n + 1) * CELLS), (v) => v * step);
    return { position_mm, pressure, peak: peaks[n] };
  });
}
