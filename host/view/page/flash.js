// Putting a model image onto the probe: the page holds the port, so the page does it.

import { get, toast } from "./dom.js";

export function startFlash() {
  document.addEventListener("click", ({ target }) => {
    if (!target.closest("[data-do=flash]")) return;
    get("flash-state").textContent = "";
    get("flash-file").value = "";
    get("dialog-flash").showModal();
  });
  get("flash-file").addEventListener("change", async () => {
    const [file] = get("flash-file").files;
    if (!file) return;
    const say = (text) => (get("flash-state").textContent = text);
    say(`Flashing ${file.name}; the stream pauses for it.`);
    get("flash-file").disabled = true;
    try {
      const headers = { "content-type": "application/octet-stream", "x-palpate": "page" };
      const answer = await fetch("/api/model", { method: "POST", headers, body: await file.arrayBuffer() });
      const said = await answer.json();
      if (!said.ok) return say(said.text);
      get("dialog-flash").close();
      toast(`The probe has model ${said.model_id} now.`);
    } catch {
      say("The viewer program does not answer.");
    } finally {
      get("flash-file").disabled = false;
    }
  });
}
