// Wires the page: what the server tells goes to the parts; one loop draws what has changed.

import { drawCard, sentence } from "./card.js";
import { StrokeCharts } from "./charts.js";
import { Connection, unpackFrame } from "./connection.js";
import { get, toast } from "./dom.js";
import { startFlash } from "./flash.js";
import { startImageTools } from "./image_tools.js";
import { startKeys } from "./keys.js";
import { TactileImage } from "./tactile_image.js";
import { startReference } from "./reference.js";
import { Replay } from "./replay.js";
import { Selected, readouts } from "./selected.js";
import { startTheme } from "./theme.js";
import { startTools } from "./tools.js";
import { VisitPanel } from "./visit_panel.js";
import { History } from "./visits.js";

const page = { frames: [], frame: null, imageNew: false, chartsNew: true, historyNew: true, held: false, running: null, awaited: false, drawn: [], link: null };
const redraw = () => Object.assign(page, { imageNew: true, chartsNew: true, historyNew: true });

const ask = (command, options) => connection.ask(command, options);
const quietly = (command, options) => ask(command, options).catch((error) => toast(error.message));
const image = new TactileImage(get("image"));
const charts = new StrokeCharts((mm) => {
  page.chartsNew = true;
  selected.hover(mm);
});
const history = new History({ ask, pick: (number) => selected.pick(number) });
const replay = new Replay(quietly);
const selected = new Selected({ image, charts, history, page, redraw });
const visitPanel = new VisitPanel({ image, history, page }, { ask, pick: (number) => selected.pick(number), redraw });
const toggleTheme = startTheme(redraw);
const connection = new Connection({ message: (message) => told[message.type]?.(message), frame: receiveFrame, closed: offline });
const tools = startTools({ ask, greeted: () => connection.greeted, image, page });
startFlash();
startImageTools(image);
const showReference = startReference(ask);
startKeys({ charts, history, page, replay, selected, toggleTheme, tools, visitPanel });
get("theme").addEventListener("click", toggleTheme);
new ResizeObserver(redraw).observe(document.querySelector("main"));
document.fonts.addEventListener("loadingdone", redraw); // canvases were drawn in whatever was there

// Frames come unevenly on a busy machine. Two may wait for a picture that would get none; where one has waited through a
// dozen pictures nobody needed it, and it is left out, so that what is drawn is not older than it must be.
const MAX_WAITING = 2;
const spare = { least: MAX_WAITING, pictures: 0 };

function receiveFrame(buffer) {
  page.frames.push(unpackFrame(buffer));
  if (page.frames.length > MAX_WAITING) page.frames.shift();
}

function nextFrame() {
  const frame = page.frames.shift();
  spare.least = Math.min(spare.least, page.frames.length);
  if (++spare.pictures < 12) return frame;
  const unneeded = spare.least > 0;
  Object.assign(spare, { least: MAX_WAITING, pictures: 0 });
  return unneeded ? page.frames.shift() : frame;
}

/** What the viewer program tells, by the type of its message. */
const told = {
  hello(message) {
    if (page.session !== message.session) begin(message.session);
    image.loadColors().then(redraw, () => {}); // without an answer the next greeting asks again
    document.body.dataset.mode = message.mode;
    document.title = `Palpate: ${message.name}`;
    showHealth(message.health);
    image.stroking = false;
    page.awaited = message.running !== null && !message.state.stroke;
    showState(message.state);
    tools.recording(message.recording);
    replay.set(message.playback);
    showVisits(message);
    showLink(message.link);
    page.running = message.running;
    selected.start(message.strokes.at(-1)?.number ?? null);
  },
  progress(message) {
    if (message.number === null) selected.jumped();
    if (visitPanel.open && page.running?.lane_mm !== message.lane_mm) page.historyNew = true;
    page.running = message.number === null ? null : message;
    if (!page.running) page.awaited = false;
    // The last stroke stays until there is something to see of the next.
    if (page.running?.map.x_mm.length > 7 && !selected.picked && !page.held) {
      charts.show(page.running);
      image.base = page.running.base;
    }
    page.chartsNew = true;
  },
  stroke(message) {
    page.running = null;
    page.awaited = false;
    image.ended(message);
    selected.finished(message);
  },
  draw: ({ age_ms }) => (get("h-age").textContent = age_ms.toFixed(0)),
  health: ({ health }) => showHealth(health),
  lanes: ({ lanes }) => visitPanel.setKnown(lanes),
  link: ({ link }) => showLink(link),
  mark: ({ text }) => toast(`Mark: ${text}`),
  notice: ({ text }) => toast(text),
  playback: ({ playback }) => replay.set(playback),
  recording: ({ recording }) => tools.recording(recording),
  refined: ({ number, refined }) => selected.refined(number, refined),
  state: ({ state }) => showState(state),
  visits: showVisits,
};

/** The first viewer program, or another one in its place. */
function begin(session) {
  for (const part of [history, replay, selected, visitPanel]) part.forget();
  Object.assign(page, { session, running: null, frame: null, held: false });
}

function showVisits(message) {
  image.visit(message.strokes.filter(({ visit }) => visit === message.current_visit));
  history.set(message);
  selected.visitsChanged();
  visitPanel.setKnown(message.lanes);
  page.historyNew = true;
}

function showLink({ state, text, device }) {
  page.link = state;
  document.body.dataset.link = state;
  const short = { connected: "Connected", gone: "Probe gone", connecting: "Looking for the probe", ended: "Played to its end" };
  get("link-text").textContent = document.body.dataset.mode === "replay" && state === "connected" ? "Recording" : short[state];
  const found = device && device.damaged.length ? `The probe found damaged in its store: ${device.damaged.join(", ")}.` : "";
  const strange = device && device.document ? `The document that was named ${device.document}.` : "";
  const told = state === "connected" || state === "ended" ? [found, strange].filter(Boolean).join(" ") : text;
  get("banner").hidden = !told;
  get("banner").replaceChildren(...sentence(told));
  page.model = device ? device.model_id : null;
  if (device) {
    showReference(device.reference);
    showForce(null, device.force_range);
    const parts = [device.name, device.serial, device.firmware && `firmware ${device.firmware}`, device.runtime];
    parts.push(device.model_id && `model ${device.model_id}`);
    get("device").textContent = parts.filter(Boolean).join(" · ");
    get("device").title = get("device").textContent;
  }
  selected.linkChanged(state);
}

function offline() {
  document.body.dataset.link = "offline";
  get("link-text").textContent = "Viewer stopped";
  get("banner").hidden = false;
  get("banner").textContent = "The viewer program does not answer. This page goes on by itself when it is back.";
}

function showHealth(health) {
  get("h-rate").textContent = health.frames_per_s.toFixed(0);
  for (const [id, value] of [["h-lost", health.lost], ["h-crc", health.crc_errors], ["h-resent", health.resent]]) {
    get(id).textContent = value;
    get(id).classList.toggle("bad", value > 0 && id !== "h-resent");
  }
  get("h-latency").textContent = health.latency_ms === null ? "–" : health.latency_ms.toFixed(1);
}

function showState(state) {
  for (const item of get("steps").querySelectorAll("[data-step]")) item.classList.toggle("on", state[item.dataset.step]);
  page.awaited = state.stroke ? false : page.awaited || image.stroking;
  image.stroking = state.stroke;
  image.resting = !state.contact;
  selected.touched(state);
  const hint = state.too_fast ? "Too fast" : state.force_high ? "Force too high" : state.force_low ? "Press harder" : "";
  get("hint").hidden = !hint;
  get("hint").textContent = hint;
}

function drawFrame(frame) {
  page.frame = frame;
  if (!selected.picked) selected.showNow();
  connection.drawn(frame.seq);
  const now = performance.now();
  page.drawn.push(now);
  while (page.drawn[0] < now - 1000) page.drawn.shift();
}

function loop() {
  requestAnimationFrame(loop);
  const frame = nextFrame();
  if (frame && page.held) connection.drawn(frame.seq);
  else if (frame) drawFrame(frame);
  if (page.imageNew && (!frame || page.held || selected.picked)) image.draw();
  page.imageNew = false;
  if (page.chartsNew) {
    page.chartsNew = false;
    charts.draw(page.running && !selected.picked ? page.frame?.position_mm ?? null : selected.place);
  }
  if (page.historyNew) {
    page.historyNew = false;
    history.draw();
    visitPanel.draw();
    selected.fitted.draw();
  }
}

const IN_AIR = 2; // N/m: less is no press

/** The bar of press quality: the force now against what the model is for, [low, high] in N/m; null: nobody knows that. */
function showForce(force, range = page.force_range) {
  page.force_range = range;
  const bar = get("force-bar");
  bar.hidden = !range;
  if (!range) return;
  const [low, high] = range;
  const end = 1.25 * high;
  const place = (v) => `${(100 * Math.min(v / end, 1)).toFixed(1)}%`;
  const [band, mark] = bar.children;
  Object.assign(band.style, { left: place(low), right: `${(100 * (1 - high / end)).toFixed(1)}%` });
  mark.hidden = !(force > IN_AIR);
  mark.style.left = place(Math.max(force, 0));
  bar.classList.toggle("off", force < low || force > high); // the mark is broad and red
  bar.setAttribute("aria-valuemax", Math.round(end));
  bar.setAttribute("aria-valuenow", Math.round(Math.min(Math.max(force, 0), end)));
  bar.title = `The model is for ${low.toFixed(0)} to ${high.toFixed(0)} N/m`;
}

function showNow() {
  if (selected.picked || page.held) return;
  const gone = document.body.dataset.link === "gone" || document.body.dataset.link === "offline";
  const frame = (!gone && page.frame) || {};
  readouts(frame);
  showForce(frame.force || 0);
}

setInterval(showNow, 125);
setInterval(() => {
  const now = performance.now();
  const lump = image.outlined?.length ? `; lump ${image.outlined.join(", ")}` : "";
  const what = image.view === "rise" ? "Rise over base" : "Pressure";
  get("image").setAttribute("aria-label", `${what} under the probe, peak ${(image.peak_kPa ?? 0).toFixed(1)} kPa${lump}`);
  get("h-drawn").textContent = page.drawn.filter((t) => t > now - 1000).length;
}, 500);

drawCard(get("card"), null, { gone: true });
requestAnimationFrame(loop);
