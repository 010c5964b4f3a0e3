// The reference press: once a visit, beside the lump.

import { get, toast } from "./dom.js";

export function startReference(ask) {
  let waits = false;
  const say = (text) => (get("reference-state").textContent = text);

  function draw() {
    get("reference-begin").disabled = get("reference-forget").disabled = waits;
  }

  async function begin() {
    waits = true;
    draw();
    say("The probe waits for the press. The picture stands still meanwhile.");
    try {
      const { text } = await ask("reference");
      say("");
      get("dialog-reference").close();
      toast(`Reference press: ${text}. It joins the strokes from now on.`);
    } catch (error) {
      say(error.message);
      if (!get("dialog-reference").open) toast(error.message);
    } finally {
      waits = false;
      draw();
    }
  }

  async function forget() {
    try {
      await ask("forget-reference");
      say("Forgotten: the strokes go without it.");
    } catch (error) {
      say(error.message);
    }
  }

  get("reference").addEventListener("click", () => {
    if (!waits) say("");
    get("dialog-reference").showModal();
  });
  get("reference-begin").addEventListener("click", begin);
  get("reference-forget").addEventListener("click", forget);

  /** What the probe keeps: a sentence, "" for none, null where its model takes none. */
  return (kept) => {
    get("reference").hidden = kept === null;
    get("reference").classList.toggle("on", Boolean(kept));
    get("reference").setAttribute("aria-pressed", Boolean(kept));
    get("reference-kept").textContent = kept ? `The probe keeps one: ${kept}.` : "The probe keeps none yet.";
    get("reference-forget").hidden = !kept;
  };
}
