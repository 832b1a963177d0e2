/* What detection sees in photographs, and why not. */

import { Gone, Refused, ask, by, digits, make, said } from "./dom.js";

/* Detect in one photograph after the other; `subject()` is a promise of what to look for. */
export async function photographs(element, files, subject) {
  by("photos-away").hidden = false;
  for (const file of files.sort((one, other) => one.name.localeCompare(other.name, undefined, { numeric: true }))) {
    const caption = make("figcaption"), into = () => figure.scrollIntoView({ block: "nearest" });
    const picture = make("img", { alt: `${file.name}, with what was found drawn in`, hidden: true, load: into });
    const figure = make("figure", {}, caption, picture);
    const tell = (text, fault) => {
      caption.textContent = `${file.name}: ${text}`;
      said(caption.textContent, fault);
    };
    element.append(figure);
    tell("looking …");
    into();
    try {
      const request = new Blob([JSON.stringify(await subject()), "\n", file]);
      const found = await (await ask("detect", request, { headers: { "X-Name": encodeURIComponent(file.name) } })).json();
      picture.src = found.overlay;
      picture.hidden = false;
      tell(words(found));
    } catch (error) {
      if (error instanceof Gone) tell("not looked at, the studio does not answer.", true);
      if (!(error instanceof Refused)) throw error;
      tell(error.message, true);
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
