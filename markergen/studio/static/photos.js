/* What detection sees in photographs, and why not; and what all of them measure. */

import { Gone, Refused, ask, by, digits, make, said, save, worded } from "./dom.js";

const taken = [];

/* Calibrate with the photographs that were taken; `subject()` is a promise of what they show, and `searching` works in the
background, as it does for a search. */
export async function calibrate(subject, searching) {
  const files = taken.map(({ name, size }) => ({ name, size }));
  const calibration = await searching("calibrate", new Blob([JSON.stringify({ ...(await subject()), files }), "\n", ...taken]));
  if (!calibration) return;
  const downloads = Object.entries(calibration.files).flatMap(([name, text]) =>
    [make("button", { type: "button", click: () => save(new Blob([text]), name) }, `Download ${name}`), " "]);
  by("calibration").replaceChildren(
    make("p", { class: !calibration.use && "fault" }, worded(calibration.verdict)), make("p", {}, downloads),
    make("details", {}, make("summary", {}, "How it was found"), calibration.sentences.map((line) => make("p", {}, worded(line)))));
  said(worded(calibration.verdict), !calibration.use);
}

/* Take all photographs away, and what they measured. */
export function away() {
  taken.length = 0;
  for (const id of ["photos", "calibration"]) by(id).replaceChildren();
  for (const id of ["photos-away", "calibrate"]) by(id).hidden = true;
}

/* Detect in one photograph after the other; `subject()` is a promise of what to look for. */
export async function photographs(element, files, subject) {
  for (const id of ["photos-away", "calibrate"]) by(id).hidden = false;
  for (const file of files.sort((one, other) => one.name.localeCompare(other.name, undefined, { numeric: true }))) {
    const caption = make("figcaption"), into = () => figure.scrollIntoView({ block: "nearest" });
    const picture = make("img", { alt: `${file.name}, with what was found drawn in`, hidden: true, load: into });
    const figure = make("figure", {}, caption, picture);
    const tell = (text, fault) => {
      caption.textContent = `${file.name}: ${text}`;
      said(caption.textContent, fault);
    };
    element.append(figure);
    taken.push(file);
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
