/* Files that are opened or dropped: what each brings into the state, and the use of a drawing. */

import { Refused, ask, by, make } from "./dom.js";
import { photographs } from "./photos.js";

const KINDS = { camera: "a camera", poses: "poses of the camera", points: "places of dots", rig: "a rig", options: "a marker, opened with all its options" };
const DRAWING = /\.(svg|dxf|geojson|kicad_pcb)$/i;

/* files(page, units) returns take(files). The page has options(), become(state), which is a promise of whether the server
takes it, stand(subject, note), seen(), a promise of what photographs show by which camera, said(text) and told(error). */
export function files(page, units) {
  const opened = {
    options: (answer) => page.become(answer.options),
    rig: (answer) => page.stand({ rig: answer.rig }, answer.title),
    marker: (answer) => page.stand({ marker: answer.marker }, answer.title),
    camera: (answer) => page.become({ ...page.options(), camera: answer.camera, camera_covariance: answer.camera_covariance ?? undefined }),
    poses: (answer) => page.become({ ...page.options(), poses: answer.poses }),
    points: (answer) => {
      const { n, target, ...others } = page.options();
      return page.become({ ...others, points: answer.points });
    },
  };
  by("drop-unit").append(make("option", { value: "" }, "as the file says"), ...units.map((unit) => make("option", { value: unit }, unit)));

  const sent = async (file, more = {}) => {
    const { drawing_center: origin } = page.options();
    const headers = { "X-Name": encodeURIComponent(file.name), ...(Array.isArray(origin) && { "X-Origin": origin.join(",") }), ...more };
    return (await ask("open", file, { headers })).json();
  };

  /* Ask what a drawing is for, in which unit and which of its layers. */
  async function drawn(file, first) {
    const dialog = by("drop"), unit = by("drop-unit"), layer = by("drop-layer"), uses = [by("drop-room"), by("drop-keep")];
    let answer = null, wanted = "", reading = null;
    const show = (found) => {
      answer = found.boundary ? found : null;
      for (const use of uses) use.disabled = !answer;
      by("drop-said").classList.toggle("fault", !answer);
      const { expected, found: instead, remedy } = found.asked || {};
      by("drop-said").textContent = answer ? `${file.name}: ${found.words}. ${found.note}` : `Expected ${expected}, found ${instead}${!remedy || /--/.test(remedy) ? "" : `; ${remedy}`}.`;
    };
    const read = async (headers) => {
      try {
        const found = await sent(file, headers);
        if (headers === wanted) show(found);
      } catch (error) {
        if (!(error instanceof Refused)) page.told(error);
        else if (headers === wanted) show({ asked: error.found });
      }
    };
    const again = () => {
      const headers = { "X-Unit": encodeURIComponent(unit.value), "X-Layer": encodeURIComponent(layer.value.trim()) };
      if (JSON.stringify(headers) !== JSON.stringify(wanted)) reading = read((wanted = headers));
    };
    const enter = (event) => {
      // It reads the layer, before the drawing is used.
      if (event.key !== "Enter") return;
      event.preventDefault();
      again();
    };
    unit.value = layer.value = "";
    show(first);
    unit.addEventListener("change", again);
    layer.addEventListener("change", again);
    layer.addEventListener("keydown", enter);
    do {
      dialog.returnValue = "";
      dialog.showModal();
      await new Promise((done) => dialog.addEventListener("close", done, { once: true }));
      await reading;
    } while (dialog.returnValue && !answer);
    unit.removeEventListener("change", again);
    layer.removeEventListener("change", again);
    layer.removeEventListener("keydown", enter);
    const use = dialog.returnValue;
    if (!use) return null;
    const { radius, boundary, ...others } = page.options();
    const taken = await (use === "boundary" ? page.become({ ...others, boundary: answer.boundary, drawing_center: answer.center })
      : page.become({ ...page.options(), keep_out: [...[page.options().keep_out || []].flat(), answer.keep_out] }));
    return taken && page.said(`${file.name}: ${answer.words}. ${answer.note}`);
  }

  async function open(file) {
    const answer = await sent(file);
    if (answer.boundary || answer.asked) return drawn(file, answer);
    const kind = Object.keys(opened).find((name) => answer[name]);
    const taken = await opened[kind](answer);
    const title = answer.title === file.name ? KINDS[kind] : answer.title;
    return taken && (answer.note || answer.marker || kind !== "options") && page.said(`${file.name}: ${answer.note || title || kind}`);
  }

  /* Take files one after the other; photographs are searched for the marker that there is then. */
  return async function take(given) {
    const pictures = [], others = [];
    for (const file of given) (/^image\/(?!svg)/.test(file.type) && !DRAWING.test(file.name) ? pictures : others).push(file);
    for (const file of others) {
      try {
        await open(file);
      } catch (error) {
        page.told(error instanceof Refused ? new Refused({ ...error.found, line: `${file.name}: ${error.message}` }) : error);
      }
    }
    if (!pictures.length) return;
    await photographs(by("photos"), pictures, page.seen).catch(page.told);
  };
}
