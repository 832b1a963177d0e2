/* The studio: a state is the options of a design; the server says what each is worth, and keeps none of them. */

import { Gone, Refused, ask, by, capital, lines, make, mm, said } from "./dom.js";
import { editor } from "./editor.js";
import * as facts from "./facts.js";
import { form } from "./options.js";
import { photographs } from "./photos.js";

const AFTER = 500, RETRY = 2000, KEPT = 200;

let known = null, options = {}, look = null, body = null, camera = null;
let past = [], future = [], pose = null, search = null, before = null, sized = null;
let fields, drawing, globe, spatial;

/* What requests are about: a rig or marker that was opened or designed, or else the options. */
const about = () => body || { options: look ? look.options : options };

function told(error) {
  if (error.name === "AbortError") return;
  if (error instanceof Gone) return lost();
  if (!(error instanceof Refused)) throw error;
  said(error.message, true);
  fields.refuse(error.found);
}

/* --- the address and the past ------------------------------------------------------------------------------- */

function written(state) {
  const bytes = new TextEncoder().encode(JSON.stringify(state));
  return btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

const address = () => history.replaceState(null, "", `#${written(options)}`);

function read(fragment) {
  if (fragment.length < 2) return null;
  try {
    const bytes = Uint8Array.from(atob(fragment.slice(1).replaceAll("-", "+").replaceAll("_", "/")), (each) => each.charCodeAt(0));
    const state = JSON.parse(new TextDecoder().decode(bytes));
    return state && typeof state === "object" && !Array.isArray(state) ? state : null;
  } catch {
    return null;
  }
}

/* Take another state; `step` puts the present one into the past. */
function become(state, step = true) {
  const before = JSON.stringify(options), after = JSON.stringify(state);
  if (step && before !== after) {
    past = [...past, before].slice(-KEPT);
    future = [];
    search?.abort();
  }
  options = JSON.parse(after);
  stands(null);
  address();
  buttons();
  return refresh();
}

/* Whether a body stands in the place of the marker. */
function stands(subject) {
  body = subject;
  by("body").hidden = !subject;
  for (const id of ["marker", "facts"]) by(id).hidden = Boolean(subject);
  document.body.classList.toggle("stands", Boolean(subject));
}

function travel(from, to) {
  if (!from.length || search) return;
  to.push(JSON.stringify(options));
  become(JSON.parse(from.pop()), false);
}

function buttons() {
  by("undo").disabled = !past.length || Boolean(search);
  by("redo").disabled = !future.length || Boolean(search);
  by("clear").hidden = !options.keep_out && typeof options.boundary !== "object";
  for (const id of ["command", "python", "share"]) by(id).disabled = Boolean(body);
  by("optimize").textContent = search ? "Stop" : "Optimize";
}

/* --- what the state is worth ---------------------------------------------------------------------------------- */

const PAGE = crypto.randomUUID();
let asked = 0, shown = 0, running = false, again = false, timer = null, slow = null;

/* One request at a time; the newest state is asked for when the last answer is there. */
async function refresh() {
  asked += 1;
  by("main").setAttribute("aria-busy", "true");
  slow?.abort();
  clearTimeout(timer);
  if (running) {
    again = true;
    return;
  }
  running = true;
  try {
    do {
      again = false;
      const number = asked;
      const answer = await (await ask("look", { options })).json();
      found();
      if (number < shown) continue;
      shown = number;
      look = answer;
      if (Array.isArray(options.points)) {
        options = { ...options, points: look.options.points };
        address();
      }
      show();
    } while (again);
  } catch (error) {
    told(error);
  } finally {
    running = false;
  }
  if (again) return refresh();
  by("main").setAttribute("aria-busy", "false");
  timer = setTimeout(rest, AFTER);
}

function show() {
  drawing.draw(look);
  fields.show(options, { n: String(look.dots.length), points: "", dot: `${mm(look.dots[0].diameter, 1)} mm` });
  fields.refuse();
  by("printed").replaceChildren(...fields.told(look.options).flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]));
  globe ? globe.update(look) : (globe = window.studioDome(by("dome"), look, { onpick: (index) => { pose = index; seeSoon(); } }));
  facts.now(look);
  if (by("table").open) listed();
  facts.problems(look.problems);
  if (!search) said(look.start ? `${capital(look.start)} to start from. Optimize searches for the best layout; or move the dots.` : "");
  document.title = `${look.dots.length} dots - markergen studio`;
  document.body.dataset.shown = shown;
}

const listed = () => facts.numbers(by("table").querySelector(".scroll"), look, (index, place) => drawing.set(index, place), (index) => drawing.remove(index));

/* What takes seconds is asked for when nothing has changed for a while. */
async function rest() {
  if (search || !look || body) return;
  see();
  if (look.problems.length) return facts.failed("After the problems above are mended.");
  facts.later(null);
  slow = new AbortController();
  try {
    facts.later(await (await ask("more", { options: look.options, page: PAGE }, { signal: slow.signal })).json());
    document.body.dataset.rested = shown;
  } catch (error) {
    if (error instanceof Refused) facts.failed(error.message);
    else told(error);
  }
}

let viewing = null, soon = null;

function seeSoon() {
  clearTimeout(soon);
  soon = setTimeout(see, 60);
}

async function see() {
  const picked = globe ? globe.picked() : pose;
  if (picked === null || picked < 0) return;
  if (look.problems.length && !body) {
    by("view-note").textContent = "After the problems of the layout are mended.";
    return;
  }
  viewing?.abort();
  viewing = new AbortController();
  try {
    const answer = await ask("view", { ...about(), pose: picked }, { signal: viewing.signal });
    const old = by("view").src;
    by("view").src = URL.createObjectURL(await answer.blob());
    if (old.startsWith("blob:")) URL.revokeObjectURL(old);
    const { tilt, azimuth, distance } = (body ? body.look : look).poses;
    const words = tilt ? `Rendered from ${distance[picked].toFixed(2)} m, tilted ${tilt[picked].toFixed(0)} deg${tilt[picked] < 0.5 ? "" : `, azimuth ${azimuth[picked].toFixed(0)} deg`}.` : "Rendered.";
    by("view").alt = `Camera image of the marker. ${words}`;
    by("view").hidden = false;
    by("view-note").textContent = words;
  } catch (error) {
    if (error instanceof Refused) by("view-note").textContent = error.message;
    else told(error);
  }
}

/* --- the server comes and goes --------------------------------------------------------------------------------- */

let waiting = null;

function lost() {
  by("gone").hidden = false;
  said("The studio does not answer.", true);
  waiting ||= setInterval(async () => {
    try {
      await ask("options");
      found();
      refresh();
    } catch { /* not yet */ }
  }, RETRY);
}

function found() {
  clearInterval(waiting);
  waiting = null;
  by("gone").hidden = true;
}

/* --- changes --------------------------------------------------------------------------------------------------- */

/* To a tenth of a nanometer, as a search leaves dots that touch the edge. */
const text = (dots) => dots.map((dot) => [dot.x, dot.y, ...(options.relief ? [dot.z || 0] : [])].map((value) => `${Number((1e3 * value).toFixed(7))}mm`).join(",")).join("; ");

/* Options with dots at these places, which keep their size. */
function placed(dots) {
  const { n, target, ...others } = options;
  if (!others.dot || others.dot === "auto") others.dot = sized = `${mm(dots[0].diameter, 2)}mm`;
  return { ...others, points: text(dots) };
}

/* Options without a size of dots that nobody asked for, which only keeps them as they are while they are moved. */
function sizeless(state) {
  const { dot, ...others } = state;
  return dot === sized ? others : state;
}

function changed(name, value) {
  const next = name === "dot" ? { ...options } : { ...sizeless(options) };
  if (value === null) delete next[name];
  else next[name] = value;
  if (name === "n" || name === "target") delete next.points;
  else if (next.points && options.dot && name !== "dot") next.dot = options.dot;
  if (name === "points") delete next.n;
  if (name === "camera") delete next.camera_covariance;
  if (name === "radius" && value !== null) delete next.boundary;
  if (name === "boundary" && value !== null) delete next.radius;
  become(next);
}

function drawn(mode, shape) {
  if (mode === "keep") become({ ...options, keep_out: [...[options.keep_out || []].flat(), shape] });
  else {
    // The marker's origin is the center of its room.
    const { radius, boundary, points, ...others } = sizeless(options), room = shape.kind === "circle" ? { radius: `${mm(shape.radius)}mm` } : { boundary: shape };
    become({ ...others, n: others.n || look.dots.length, ...room });
  }
  pick("move");
}

const HINTS = {
  move: "Drag a dot, or Tab to it and use the arrow keys: 1 mm, with Shift 10 mm, with Alt 0.1 mm; Delete removes it.",
  add: "Click where a dot should be.",
  remove: "Click a dot to remove it.",
  room: "Click the corners, and the first one again or Enter to close; two opposite corners make a rectangle. Drag from the center for a circle. Escape starts anew.",
  keep: "A region without dots: click its corners, and the first one again or Enter to close; two opposite corners make a rectangle. Drag from the center for a circle.",
};

function pick(mode) {
  for (const button of by("modes").querySelectorAll("[data-mode]")) button.setAttribute("aria-pressed", String(button.dataset.mode === mode));
  by("hint").textContent = HINTS[mode];
  drawing.mode(mode);
}

/* --- searches ---------------------------------------------------------------------------------------------------- */

/* Run a search to its last line; its progress is shown, and pressing the button again stops it. */
async function searching(path, request, onstep) {
  search = new AbortController();
  by("progress").hidden = false;
  buttons();
  try {
    let last = null;
    for await (const line of lines(path, request, search.signal)) {
      last = line;
      if (line.stage) {
        by("progress").max = line.total || 1;
        by("progress").value = Math.min(line.done, line.total || 1);
        said(`${line.stage} ${line.done} of ${line.total}`);
      }
      onstep?.(line);
    }
    if (last?.error) throw new Refused(last.error);
    return last;
  } catch (error) {
    if (error.name === "AbortError") said("Stopped; nothing has changed.");
    else if (error instanceof Refused || error instanceof Gone) told(error);
    else lost();
    return null;
  } finally {
    search = null;
    by("progress").hidden = true;
    drawing.ghost([]);
    buttons();
  }
}

async function optimize() {
  if (search) return search.abort();
  const { points, ...others } = sizeless(options);
  const count = others.n || others.target ? {} : { n: look?.dots.length || 5 };
  const end = await searching("optimize", { options: { ...others, ...count } }, (line) => line.dots && drawing.ghost(line.dots));
  if (!end) return;
  if (end.options) {
    if (!others.dot) sized = end.options.dot;
    await become(end.options);
    said(`Done: ${end.certificate.sentence}.`);
  } else await stand({ marker: end.marker }, "Dots of several sizes serve these distances; change an option to begin anew.");
}

/* --- bodies in three dimensions ------------------------------------------------------------------------------------ */

async function stand(subject, note) {
  try {
    const answer = await (await ask("scene", subject)).json();
    stands({ ...subject });
    Object.defineProperty(body, "look", { value: { ...answer, room: { outlines: [], radius: 0.1 }, dots: [] } });
    by("body-note").textContent = [note, answer.expected].filter(Boolean).join(". ");
    const { show } = await import("./rig3d.js");
    spatial?.dispose();
    by("stage").replaceChildren();
    const bytes = Uint8Array.from(atob(answer.glb), (each) => each.charCodeAt(0));
    spatial = show(by("stage"), bytes.buffer, body.look);
    globe.update(body.look);
    buttons();
    see();
    said(note);
    by("body").scrollIntoView({ block: "nearest" });
  } catch (error) {
    told(error);
  }
}

/* --- files --------------------------------------------------------------------------------------------------------- */

const opened = {
  options: (answer) => become(answer.options),
  rig: (answer) => stand({ rig: answer.rig }, answer.title),
  boundary: async (answer) => {
    by("drop").returnValue = "";
    by("drop").showModal();
    await new Promise((done) => by("drop").addEventListener("close", done, { once: true }));
    const use = by("drop").returnValue;
    if (use === "keep_out") return become({ ...options, keep_out: [...[options.keep_out || []].flat(), answer.boundary] });
    if (use !== "boundary") return null;
    const { radius, points, ...others } = sizeless(options);
    return become({ ...others, n: others.n || look.dots.length, boundary: answer.boundary });
  },
  camera: (answer) => {
    camera = { camera: answer.camera, camera_covariance: answer.camera_covariance };
    return become({ ...options, ...camera });
  },
  poses: (answer) => become({ ...options, poses: answer.poses }),
  points: (answer) => {
    const { n, ...others } = options;
    return become({ ...others, points: answer.points });
  },
};

const KINDS = { boundary: "a drawing", camera: "a camera", poses: "poses of the camera", points: "places of dots", rig: "a rig" };

async function take(files) {
  const pictures = [], others = [];
  for (const file of files) (/^image\/(?!svg)/.test(file.type) ? pictures : others).push(file);
  for (const file of others) {
    try {
      const answer = await (await ask("open", file, { headers: { "X-Name": encodeURIComponent(file.name) } })).json();
      const kind = answer.options === null && answer.marker ? "marker" : Object.keys(opened).find((name) => answer[name]);
      if (kind === "marker") await stand({ marker: answer.marker }, answer.title);
      else await opened[kind](answer);
      const title = answer.title === file.name ? KINDS[kind] : answer.title;
      if (answer.note || kind !== "options") said(`${file.name}: ${answer.note || title || kind}`);
    } catch (error) {
      told(error instanceof Refused ? new Refused({ ...error.found, line: `${file.name}: ${error.message}` }) : error);
    }
  }
  if (pictures.length) await photographs(by("photos"), pictures, () => ({ ...about(), ...camera })).catch(told);
}

async function download() {
  const suffix = by("suffix").value;
  said(`Writing ${suffix} …`);
  try {
    const answer = await ask("export", { ...about(), suffix });
    const name = decodeURIComponent(/filename\*=UTF-8''([^;]+)/.exec(answer.headers.get("Content-Disposition") || "")?.[1] || `marker${suffix}`);
    const link = make("a", { href: URL.createObjectURL(await answer.blob()), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1e4);
    said(`Downloaded ${name}.`);
  } catch (error) {
    told(error);
  }
}

async function copy(what) {
  try {
    const words = what === "share" ? location.href : (await (await ask("words", { options: look.options })).json())[what];
    try {
      await navigator.clipboard.writeText(words);
      said(what === "share" ? "Copied the link: it holds the whole design." : `Copied: ${words.split("\n").slice(0, 4).join(" ")}`);
    } catch {
      said(`Copy this: ${words}`);
    }
  } catch (error) {
    told(error);
  }
}

/* --- begin --------------------------------------------------------------------------------------------------------- */

async function build(shape, sized) {
  if (search) return;
  const end = await searching("rig", { shape, options: sized });
  if (end) await stand({ rig: end.rig }, end.summary?.split("\n")[0] || shape);
}

const typing = ({ target }) => /^(INPUT|TEXTAREA|SELECT)$/.test(target.tagName) && target.type !== "checkbox";

function listen() {
  by("undo").addEventListener("click", () => travel(past, future));
  by("redo").addEventListener("click", () => travel(future, past));
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || typing(event)) return;
    const key = event.key.toLowerCase();
    if (key === "z") event.shiftKey ? travel(future, past) : travel(past, future);
    else if (key === "y") travel(future, past);
    else return;
    event.preventDefault();
  });
  by("optimize").addEventListener("click", optimize);
  by("back").addEventListener("click", () => become(options, false));
  by("open").addEventListener("click", () => by("files").click());
  by("files").addEventListener("change", async () => {
    await take([...by("files").files]);
    by("files").value = "";
  });
  by("download").addEventListener("click", download);
  for (const id of ["command", "python", "share"]) by(id).addEventListener("click", () => copy(id));
  by("theme").addEventListener("change", () => {
    if (by("theme").value) document.documentElement.dataset.theme = by("theme").value;
    else delete document.documentElement.dataset.theme;
    try { localStorage.theme = by("theme").value; } catch { /* not kept */ }
  });
  for (const button of by("modes").querySelectorAll("[data-mode]")) button.addEventListener("click", () => pick(button.dataset.mode));
  by("clear").addEventListener("click", () => {
    const { keep_out, boundary, ...others } = options;
    become(typeof boundary === "string" ? { ...others, boundary } : others);
  });
  by("table").addEventListener("toggle", () => by("table").open && look && listed());
  by("find").addEventListener("input", () => fields.find(by("find").value));
  by("photos-away").addEventListener("click", () => {
    by("photos").replaceChildren();
    by("photos-away").hidden = true;
    by("open").focus();
  });
  by("form").addEventListener("submit", (event) => event.preventDefault());
  by("template").addEventListener("change", () => {
    const chosen = known.templates.find((each) => each.name === by("template").value);
    by("template").value = "";
    if (chosen?.shape) build(chosen.shape, chosen.options);
    else if (chosen) become(chosen.options);
  });
  by("rig").addEventListener("submit", (event) => {
    event.preventDefault();
    const shape = by("shape").value.trim() || "cube", edge = by("edge").value.trim();
    build(shape, edge && !shape.startsWith("wall") && !shape.startsWith("pair") ? { edge } : {});
  });
  for (const name of ["dragenter", "dragover"]) {
    document.addEventListener(name, (event) => {
      if (![...event.dataTransfer.types].includes("Files")) return;
      event.preventDefault();
      document.body.classList.add("dropping");
    });
  }
  document.addEventListener("dragleave", (event) => event.relatedTarget || document.body.classList.remove("dropping"));
  document.addEventListener("drop", (event) => {
    document.body.classList.remove("dropping");
    if (!event.dataTransfer.files.length) return;
    event.preventDefault();
    take([...event.dataTransfer.files]);
  });
  document.addEventListener("paste", (event) => {
    const state = !typing(event) && read(`#${event.clipboardData.getData("text").trim().split("#")[1] || ""}`);
    if (!state) return;
    event.preventDefault();
    become(state).then(() => said("The design of the link."));
  });
  window.addEventListener("hashchange", () => {
    const state = read(location.hash);
    if (state && JSON.stringify(state) !== JSON.stringify(options)) become(state);
  });
}

async function begin() {
  window.studioDome = dome;
  try {
    by("theme").value = localStorage.theme || "";
    if (by("theme").value) document.documentElement.dataset.theme = by("theme").value;
  } catch { /* no storage */ }
  for (;;) {
    try {
      known = await (await ask("options")).json();
      break;
    } catch (error) {
      if (!(error instanceof Gone)) throw error;
      by("gone").hidden = false;
      await new Promise((done) => setTimeout(done, RETRY));
    }
  }
  found();
  fields = form(by("form"), known, changed);
  drawing = editor(by("canvas"), {
    moving: (dots) => { before ??= JSON.stringify(options); options = placed(dots); refresh(); },
    moved: (dots) => {
      const next = placed(dots);
      if (before) options = JSON.parse(before);
      before = null;
      become(next);
    },
    drawn,
    said,
  });
  by("suffix").append(...known.formats.map((each) => make("option", { value: each.suffix, title: each.words }, each.suffix)));
  by("template").append(make("option", { value: "" }, "a template …"), ...known.templates.map((each) => make("option", { value: each.name }, `${each.name}: ${each.title}`)));
  listen();
  pick("move");
  const opening = known.opened, linked = location.hash.length > 1, state = read(location.hash);
  options = state || opening?.options || {};
  await become(options, false);
  if (linked && !state) said("The address holds no design; this is a new one.", true);
  if (opening?.note && !linked) said(`${opening.title}: ${opening.note}`);
  if (opening && !linked && !opening.options) {
    if (opening.rig) await stand({ rig: opening.rig }, opening.title);
    else if (opening.marker) await stand({ marker: opening.marker }, opening.title);
  }
}

begin();
