// What every part of the page does with its elements.

export const get = (id) => document.getElementById(id);

export function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

/** A short notice. */
export function toast(text) {
  const note = element("p", {}, text);
  get("toasts").append(note);
  setTimeout(() => note.remove(), 5000);
}

/** What the server has at this path; null where it cannot be had. */
export async function fetched(path) {
  try {
    const answer = await fetch(path);
    return answer.ok ? await answer.json() : null;
  } catch {
    return null;
  }
}

/** Give the reader a canvas as a PNG file. */
export function save(canvas, name) {
  canvas.toBlob((blob) => {
    const link = element("a", { download: name, href: URL.createObjectURL(blob) });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60_000); // when the browser has surely read it
  });
}

/** A number as text, with a minus as long as a plus and none before a zero. */
export const decimal = (v, digits = 1) => (+v.toFixed(digits) || 0).toFixed(digits).replace("-", "\u2212");

/** A time of this day. */
export const timeOf = (wall_time) => new Date(wall_time * 1000).toLocaleTimeString([], { hour12: false });
