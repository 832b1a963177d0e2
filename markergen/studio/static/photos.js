/* What detection sees in photographs, and why not. */

import { Refused, ask, digits, make } from "./dom.js";

/* Detect in one photograph after the other; `subject()` is a promise of what to look for. */
export async function photographs(element, files, subject) {
  for (const file of files) {
    const said = make("figcaption", {}, `${file.name}: looking …`), picture = make("img", { alt: `${file.name}, with what was found drawn in`, hidden: true });
    element.prepend(make("figure", {}, picture, said));
    try {
      const request = new Blob([JSON.stringify(await subject()), "\n", file]);
      const found = await (await ask("detect", request, { headers: { "X-Name": encodeURIComponent(file.name) } })).json();
      picture.src = found.overlay;
      picture.hidden = false;
      said.replaceChildren(`${file.name}: ${words(found)}`);
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      said.textContent = `${file.name}: ${error.message}`;
    }
  }
}

function words(found) {
  if (!found.found) return `not found: ${found.why}.`;
  const labeled = found.dots.filter((dot) => dot.id !== null).length;
  const place = found.pose?.tvec || found.pose?.translation;
  const distance = place ? ` ${digits(Math.hypot(...place))} m away.` : " Give a camera file for its pose.";
  return [`found, ${labeled} dots.${distance}`, ...(found.notes || [])].join(" ");
}
