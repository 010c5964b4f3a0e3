// Keyboard. Letters do nothing while somebody types into a field or a dialog is open.

import { get, toast } from "./dom.js";

export function startKeys({ charts, history, page, replay, selected, toggleTheme, tools, visitPanel }) {
  const hold = () => {
    const { mode } = document.body.dataset;
    if (mode === "replay") replay.toggle();
    if (mode !== "live") return; // the page does not know yet what it shows
    page.held = !page.held;
    toast(page.held ? "The picture is held. Space goes on." : "Live again.");
    selected.showLast();
  };
  const once = new Set([" ", "r", "m", "v", "e", "l", "p", "t", "?"]); // a key held down does these once
  const keys = {
    " ": hold,
    ArrowUp: () => selected.pick(history.neighbour(1)),
    ArrowDown: () => selected.pick(history.neighbour(-1)),
    ArrowLeft: (event) => replay.step(event.shiftKey ? -10 : -1),
    ArrowRight: (event) => replay.step(event.shiftKey ? 10 : 1),
    "[": () => replay.state && replay.faster(-1),
    "]": () => replay.state && replay.faster(1),
    "+": () => charts.zoomBy(0.5),
    "-": () => charts.zoomBy(2),
    0: () => charts.zoomBy(Infinity),
    Escape: () => selected.back(),
    r: () => tools.record(),
    m: () => tools.mark(),
    v: () => tools.visit(),
    l: () => visitPanel.toggle(),
    p: () => get("reference").hidden || get("reference").click(),
    e: () => {
      get("export").open = !get("export").open;
      get("export").querySelector("summary").focus({ focusVisible: true });
    },
    t: toggleTheme,
    "?": () => get("dialog-help").showModal(),
  };
  /** Wherever the focus is, Esc closes the menu first; the focus goes to where the menu was. */
  const closeMenu = (event, menu) => {
    event.preventDefault();
    menu.open = false;
    menu.querySelector("summary").focus({ focusVisible: true });
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    const menu = event.key === "Escape" && document.querySelector(".menu[open]");
    if (menu) return closeMenu(event, menu);
    if (!event.target.closest("dialog") && isForControl(event)) return;
    // A dialog that has just closed keeps the focus until the next picture; a key pressed meanwhile is for the page.
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (!keys[key]) return;
    event.preventDefault();
    if (!event.repeat || !once.has(key)) keys[key](event);
  });
}

/** Does the control that has the focus use this key itself? */
function isForControl({ key, target }) {
  if (target.closest("input[type=range], #image")) return key.startsWith("Arrow");
  if (target.closest("input[type=checkbox]")) return key === " ";
  if (target.closest("input, select, textarea")) return true;
  return Boolean(target.closest("button, summary, a")) && (key === " " || key === "Enter");
}
