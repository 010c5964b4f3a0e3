// Record, mark, new visit and export.

import { get, save, toast } from "./dom.js";

export function startTools({ ask, greeted, image, page }) {
  let recording = null; // as the server told it last
  let wanted = null; // what recording will be when every press is answered; null: nothing is on its way
  let pressed = 0; // presses on their way
  let turning = Promise.resolve(); // starts, stops and marks go to the server one after the other

  const run = (command, options) => ask(command, options).catch((error) => toast(error.message));

  function showRecording(now) {
    recording = now;
    get("record").classList.toggle("on", Boolean(now));
    get("record").setAttribute("aria-pressed", Boolean(now));
    tick();
  }

  function tick() {
    const seconds = recording ? Math.max(0, Date.now() / 1000 - recording.since) : 0;
    const clock = `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;
    get("record-text").textContent = recording ? `Stop ${clock}` : "Record";
  }

  function record() {
    if (document.body.dataset.mode === "replay") return;
    const wish = !(wanted ?? Boolean(recording));
    wanted = wish;
    pressed += 1;
    turning = turning.then(async () => {
      await turn(wish);
      pressed -= 1;
      if (!pressed) wanted = null;
    });
  }

  async function turn(wish) {
    await greeted();
    if (Boolean(recording) === wish) return;
    const answer = await run(wish ? "record" : "stop-recording");
    if (answer) toast(wish ? `Recording to ${answer.file}.` : `Saved as ${answer.file}.`);
  }

  // The dialog's answer is taken when it is given: "close" comes later, when keys may have opened the next one.
  let answered = () => {};

  /** Ask for a line of text; the dialog is open when this returns. Resolves with the text, or null. */
  function text(title) {
    answered(null);
    get("text-title").textContent = title;
    get("text-value").value = "";
    get("dialog-text").showModal();
    return new Promise((resolve) => (answered = resolve));
  }

  get("dialog-text").addEventListener("submit", ({ submitter }) => {
    answered(submitter.value === "ok" ? get("text-value").value : null);
  });
  get("dialog-text").addEventListener("close", () => {
    if (!get("dialog-text").open) answered(null); // by Esc
  });

  function mark() {
    if (document.body.dataset.mode === "replay") return;
    if (!(wanted ?? recording)) return toast("Marks go into a recording. Press R to record.");
    const note = text("Mark this moment");
    turning = turning.then(async () => {
      if ((await note) !== null) await run("mark", { text: await note });
    }); // after the start that was asked for before it, and before the stop that is asked for after it
  }

  async function visit() {
    const name = await text("Name of the new visit");
    if (name === null) return;
    if (await run("new-visit", name.trim() ? { name } : {})) toast("A new visit has begun; strokes go there from now on.");
  }

  function saveImage() {
    save(image.canvas, `tactile-image-${page.frame?.seq ?? 0}.png`);
    get("export").open = false;
  }

  get("record").addEventListener("click", record);
  get("mark").addEventListener("click", mark);
  get("new-visit").addEventListener("click", visit);
  get("export-image").addEventListener("click", saveImage);
  get("help").addEventListener("click", () => get("dialog-help").showModal());
  document.addEventListener("click", ({ target }) => {
    for (const menu of document.querySelectorAll(".menu[open]")) menu.open = menu.contains(target) && !target.closest(".menu-items a");
  });
  setInterval(tick, 500);

  return { recording: showRecording, record, mark, visit };
}
