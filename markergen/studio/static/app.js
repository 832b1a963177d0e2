/* The studio: a state is the options of a design; the server says what each is worth, and keeps none of them. */

import { Gone, Refused, ask, by, capital, digits, lines, make, mm, said, save, worded } from "./dom.js";
import { read, written } from "./address.js";
import { editor } from "./editor.js";
import * as facts from "./facts.js";
import { files } from "./files.js";
import { form } from "./options.js";
import { away, calibrate } from "./photos.js";

const AFTER = 500, RETRY = 2000, KEPT = 200;
const COPIES = { command: "Command", python: "Python", spec: "Spec", share: "Link" };
/* Nearest over farthest distance of the poses that are the default, and their largest tilt. */
const NEAREST = 0.4, TILT = 70;
/* Options that the first questions are about. */
const ANSWERS = { "first-paper": "paper", "first-camera": "camera", "first-far": "poses" };

let known = null, options = {}, look = null, body = null;
/* Rigs of this page by their states, and the latest state that is none of a rig. */
const rigs = new Map();
let flat = {};
let past = [], future = [], pose = null, search = null, before = null;
let fields, fitted, drawing, globe, spatial, numbers, take;

/* The newest state as the server takes it; raises what was wrong with it. */
async function settled() {
  if (body?.designed) return options;
  await running;
  if (fault) throw fault;
  return look.options;
}

/* What requests are about: a rig or marker that was opened or designed, or else the options. */
const about = async () => body || { options: await settled() };
const seen = async () => ({ ...(await about()), camera: options.camera, camera_covariance: options.camera_covariance });

function told(error) {
  if (error.name === "AbortError") return;
  if (error instanceof Gone) return lost();
  if (!(error instanceof Refused)) throw error;
  said(error.message, true);
  mark(error);
}

/* Mark the fields of what was refused, and the questions that they answer; nothing without an error. */
function mark(error) {
  const wrong = fields.refuse(error?.found, error?.message);
  for (const [id, name] of Object.entries(ANSWERS)) by(id).setAttribute("aria-invalid", wrong.includes(name));
}

/* --- the address and the past ------------------------------------------------------------------------------- */

const address = () => history.replaceState(null, "", written(options));

/* Take another state; `step` puts the present one into the past. Returns a promise of whether the server takes it. */
function become(state, step = true) {
  const before = JSON.stringify(options), after = JSON.stringify(state);
  if (state.shape && !rigs.has(after)) return design(state, step);
  if (step && before !== after) {
    past = [...past, before].slice(-KEPT);
    future = [];
    search?.abort();
  }
  if (state.shape && !options.shape) flat = options;
  options = JSON.parse(after);
  address();
  fit();
  if (state.shape) {
    by("shape").value = options.shape;
    if (options.edge) by("edge").value = options.edge;
    fields.show(options);
    mark();
    const { rig, summary, warnings } = rigs.get(after);
    return stand({ rig }, [summary.split("\n")[0], ...warnings.map((each) => worded(capital(each)))].join(". "), true);
  }
  stands(null);
  buttons();
  return refresh();
}

/* A state with a shape is that of a rig, its options those of `markergen rig`; it is taken when a search has made it. */
async function design(state, step) {
  const { shape, ...others } = state;
  const end = await searching("rig", { shape, options: others });
  if (!end) return false;
  rigs.set(JSON.stringify(state), end);
  return become(state, step);
}

/* The form has the options of what is designed: those of a rig are others. */
function fit() {
  const kind = options.shape ? "rig" : "marker";
  if (kind === fitted) return;
  fitted = kind;
  by("first").hidden = kind === "rig";
  by("find").value = "";
  fields = form(by("form"), known.forms[kind], changed);
}

/* Whether a body stands in the place of the marker. */
function stands(subject) {
  body = subject;
  by("body").hidden = !subject;
  for (const id of ["marker", "facts"]) by(id).hidden = Boolean(subject);
  document.body.classList.toggle("stands", Boolean(subject));
}

function travel(from, to) {
  if (!from.length || search || drawing.held()) return;
  to.push(JSON.stringify(options));
  become(JSON.parse(from.pop()), false);
}

function buttons() {
  by("undo").disabled = !past.length || Boolean(search);
  by("redo").disabled = !future.length || Boolean(search);
  by("clear").hidden = ![options.boundary, ...keepOuts()].some(isDrawn);
  by("copy").disabled = Boolean(body) && !body.designed;
  // Until a search has ended, what is shown only stands in for its result.
  by("download").disabled = Boolean(search);
  by("optimize").textContent = search ? "Stop" : "Optimize";
  // It would search for a marker that is not shown.
  by("optimize").disabled = Boolean(body) && !search;
}

/* --- what the state is worth ---------------------------------------------------------------------------------- */

const PAGE = crypto.randomUUID();
let begun = false, asked = 0, running = null, fault = null, timer = null, slow = null;

/* Ask what the newest state is worth. Returns a promise of whether the server takes it. */
function refresh() {
  if (options.shape) return Promise.resolve(true);
  asked += 1;
  by("main").setAttribute("aria-busy", "true");
  slow?.abort();
  clearTimeout(timer);
  running ||= catchUp();
  return running;
}

/* One request at a time; the newest state is asked for when the last answer is there. */
async function catchUp() {
  try {
    for (let number = 0; number !== asked;) {
      number = asked;
      try {
        const answer = await (await ask("look", { options })).json();
        if (options.shape) break;
        look = answer;
        fault = null;
        found();
        show(number);
      } catch (error) {
        fault = error;
        if (number === asked) refused(error);
      }
    }
  } finally {
    running = null;
  }
  by("main").setAttribute("aria-busy", String(!begun));
  document.body.classList.toggle("refused", Boolean(fault));
  timer = setTimeout(rest, AFTER);
  return !fault;
}

/* Numbers follow every answer. Dots and fields are those of the newest state: newer ones are not replaced by older ones. */
function show(number) {
  if (number === asked) {
    if (Array.isArray(options.points)) {
      options = { ...options, points: look.options.points };
      address();
    }
    drawing.draw(look);
    fill();
    if (by("table").open) numbers(look);
    printed(look.options);
    facts.problems(look.problems);
    const start = look.start && `${capital(look.start)} to start from.`;
    if (!search) said(start || look.problems.length ? `${start} Optimize searches for the best layout; or move the dots.`.trim() : "");
  }
  globe ? globe.update(look) : (globe = window.studioDome(by("dome"), look, { onpick: (index) => { pose = index; seeSoon(); } }));
  facts.now(look);
  document.title = `${look.dots.length} dots - markergen studio`;
  document.body.dataset.shown = number;
}

const fill = () => {
  by("first-paper").value = options.paper || look?.options.paper || "";
  by("first-camera").value = typeof options.camera === "object" ? "file" : options.camera === "phone" ? "phone" : "";
  if (document.activeElement !== by("first-far")) by("first-far").value = /distance=(?:[^,]*\.\.)?(-?[\d.]+)m?,/.exec(options.poses)?.[1] ?? "";
  if (look) by("first-far").placeholder = `${[Math.min, Math.max].map((end) => Number(digits(end(...look.poses.distance), 2))).join("\u2013")}${options.poses ? "" : ", the paper\u2019s"}`;
  fields.show(options, look ? {
    n: String(look.dots.length), points: "", dot: `${mm(look.dots[0].diameter, 1)} mm`, print_sigma: `${Number(mm(look.print_sigma, 4))}mm`, noise_model: look.noise_model,
    radius: options.boundary ? "by the shape of the room" : `${mm(look.room.radius, 0)}mm`,
  } : {});
  mark();
};

/* On paper stand the options of a state. */
const printed = (state) => by("printed").replaceChildren(...fields.told(state).flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]));

/* The form has what is refused; all else is that of the last state that was taken. */
function refused(error) {
  if (error instanceof Refused) {
    fill();
    if (look) drawing.draw(look);
  }
  told(error);
}

/* What takes seconds is asked for when nothing has changed for a while. */
async function rest() {
  if (!look || body) return;
  if (look.problems.length && !search) facts.failed("After the problems above are mended.");
  else facts.later(null);
  if (search) return;
  see();
  page();
  if (look.problems.length) return;
  slow = new AbortController();
  try {
    facts.later(await (await ask("more", { options: look.options, page: PAGE }, { signal: slow.signal })).json());
    document.body.dataset.rested = document.body.dataset.shown;
  } catch (error) {
    if (error instanceof Refused) facts.failed(error.message);
    else told(error);
  }
}

/* The sheet as it is printed, while it is looked at. */
async function page() {
  if (!by("sheet").open || !look || look.problems.length) return;
  try {
    const answer = await ask("export", { options: look.options, suffix: ".png" });
    if (answer.headers.get("Content-Type") !== "image/png") return;
    URL.revokeObjectURL(by("page").src);
    by("page").src = URL.createObjectURL(await answer.blob());
    by("page").alt = `Sheet of ${look.options.paper || "the smallest paper that holds it"}, with its rulers`;
  } catch (error) {
    told(error);
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
    const answer = await ask("view", { ...(body || { options: look.options }), pose: picked }, { signal: viewing.signal });
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
  if (!others.dot || others.dot === "auto") others.dot = others.sized = `${mm(dots[0].diameter, 2)}mm`;
  return { ...others, points: text(dots) };
}

/* Options without a size of dots that nobody asked for, which only keeps them as they are: that under `sized`. */
function sizeless({ sized, ...state }) {
  const { dot, ...others } = state;
  return sized && dot === sized ? others : state;
}

/* Options that say the same in another way, or belong to another value: who gives one leaves out the others. */
const INSTEAD = {
  n: ["points", "target"], target: ["points", "n"], points: ["n", "target"], camera: ["camera_covariance"],
  radius: ["boundary", "drawing_center"], boundary: ["radius", "drawing_center"],
};

function changed(name, value) {
  const next = { ...sizeless(options) };
  if (value === null) delete next[name];
  else next[name] = value;
  if (name === "keep_out" && keepOuts().some(isDrawn)) next.keep_out = [...(value || []), ...keepOuts().filter(isDrawn)];
  if (value !== null || name === "camera") for (const each of INSTEAD[name] || []) delete next[each];
  // Where nothing says what the room is, it is the page.
  if (value === null && (name === "radius" || name === "boundary")) Object.assign(next, pageRoom());
  // Dots in a plane have no heights.
  if (name === "relief" && next.points && !value !== !options.relief) {
    delete next.points;
    next.n = look.dots.length;
  }
  if (next.points && options.dot && name !== "dot") Object.assign(next, { dot: options.dot, sized: options.sized });
  become(next);
}

const pageRoom = () => ({ boundary: "page", paper: options.paper || known.paper });
const keepOuts = () => [options.keep_out || []].flat();
const isDrawn = (shape) => typeof shape === "object";

let turn = Promise.resolve();

/* Take a region that was drawn or moved into the state, one after the other; a promise of whether it can be. */
function region(change) {
  turn = turn.then(async () => {
    try {
      for (;;) {
        const from = options, answer = await (await ask("region", { options: from, ...change })).json();
        // What has changed meanwhile is kept.
        if (options !== from) continue;
        become(answer.options);
        return true;
      }
    } catch (error) {
      if (look) drawing.draw(look);
      told(error);
      return false;
    }
  });
  return turn;
}

async function drawn(mode, shape) {
  const taken = await region({ [mode === "keep" ? "keep_out" : "room"]: shape });
  if (taken) pick("move");
  return taken;
}

const KEYS = "By keyboard: Tab into the drawing, move the cross with the arrow keys;";
const DRAWN = `Ctrl+Z takes back a corner, Escape all. ${KEYS} Space sets a corner.`;
const HINTS = {
  move: "Drag a dot or a keep-out, or Tab to it and use the arrow keys: 1 mm, with Shift 10 mm, with Alt 0.1 mm; Delete removes it, Escape ends dragging.",
  add: `Click where a dot should be. ${KEYS} Space adds a dot.`,
  remove: "Click a dot or a keep-out to remove it.",
  room: `Click the corners, and the first one again or Enter to close; two opposite corners make a rectangle. Drag from the center for a circle. ${DRAWN} Its center becomes the marker's origin.`,
  keep: `A region without dots: click its corners, and the first one again or Enter to close; two opposite corners make a rectangle. Drag from the center for a circle. ${DRAWN}`,
};

function pick(mode) {
  for (const button of by("modes").querySelectorAll("[data-mode]")) button.setAttribute("aria-pressed", String(button.dataset.mode === mode));
  by("hint").textContent = HINTS[mode];
  const within = by("canvas").firstChild === document.activeElement;
  drawing.mode(mode);
  // Who has drawn by keyboard goes on from there.
  if (within && mode === "move") by("modes").querySelector("[data-mode=move]").focus({ preventScroll: true });
}

/* --- searches ---------------------------------------------------------------------------------------------------- */

/* Run a search to its last line, instead of one that runs; its progress is shown. */
async function searching(path, request, onstep) {
  let finish;
  while (search) {
    search.abort();
    await search.end;
  }
  search = Object.assign(new AbortController(), { end: new Promise((done) => { finish = done; }) });
  by("progress").hidden = false;
  buttons();
  try {
    let last = null;
    for await (const line of lines(path, request, search.signal)) {
      last = line;
      if (line.stage) {
        by("progress").max = line.total || 1;
        by("progress").value = Math.min(line.done, line.total || 1);
        said(`${capital(known.stages[line.stage] || line.stage)}, ${line.done} of ${line.total}`);
      }
      onstep?.(line);
    }
    if (last?.error) throw new Refused(last.error);
    return last;
  } catch (error) {
    if (error instanceof Refused || error instanceof Gone) told(error);
    else if (error.name !== "AbortError") lost();
    return null;
  } finally {
    search = null;
    by("progress").hidden = true;
    drawing.ghost([]);
    clearTimeout(timer);
    timer = setTimeout(rest, AFTER);
    buttons();
    finish();
  }
}

async function optimize() {
  const { points, ...others } = sizeless(options);
  const count = others.n || others.target ? {} : { n: look?.dots.length || 5 };
  const end = await searching("optimize", { options: { ...others, ...count } }, (line) => line.dots && drawing.ghost(line.dots));
  if (!end) return;
  said("Found; its errors come next.");
  if (end.options) {
    const notes = { drawing_center: options.drawing_center, sized: others.dot ? undefined : end.options.dot };
    if (await become({ ...end.options, ...notes })) said(end.certificate ? `Done: ${end.certificate.sentence}.` : "Done.");
  } else if (await become({ ...others, ...count })) {
    await stand({ marker: end.marker }, "Dots of several sizes serve these distances; change an option to begin anew.", true);
  }
}

/* --- bodies in three dimensions ------------------------------------------------------------------------------------ */

/* Show a body; of one that was designed here the state says how. */
async function stand(subject, note, designed = false) {
  try {
    const answer = await (await ask("scene", subject)).json();
    stands({ ...subject });
    Object.defineProperty(body, "designed", { value: designed });
    Object.defineProperty(body, "look", { value: { ...answer, room: { outlines: [], radius: 0.1 }, dots: [] } });
    by("body-note").textContent = [note, answer.expected].filter(Boolean).join(". ");
    const { show } = await import("./rig3d.js");
    spatial?.dispose();
    by("stage").replaceChildren();
    printed(designed ? options : {});
    const bytes = Uint8Array.from(atob(answer.glb), (each) => each.charCodeAt(0));
    spatial = show(by("stage"), bytes.buffer, body.look);
    globe.update(body.look);
    buttons();
    see();
    said(note);
    by("body").scrollIntoView({ block: "nearest" });
    return true;
  } catch (error) {
    told(error);
    return false;
  }
}

/* --- what leaves the page ------------------------------------------------------------------------------------------- */

async function download() {
  const suffix = by("suffix").value;
  said(`Writing ${suffix} …`);
  try {
    // A spec is that of the state, of a rig as well; a file that stands there has none.
    const what = suffix === ".toml" && body?.designed !== false ? { options: await settled() } : await about();
    const answer = await ask("export", { ...what, suffix });
    const name = decodeURIComponent(/filename\*=UTF-8''([^;]+)/.exec(answer.headers.get("Content-Disposition") || "")?.[1] || `marker${suffix}`);
    save(await answer.blob(), name);
    said(`Downloaded ${name}${!body && look.start ? `: ${look.start}, as shown. Optimize searches for the best layout` : ""}.`);
  } catch (error) {
    told(error);
  }
}

const COPIED = { share: "the link: it holds the whole design", python: "the Python", spec: "the spec, a file for markergen design --template" };

async function copy(what) {
  try {
    const state = await settled(), words = what === "share" ? location.href : (await (await ask("words", { options: state })).json())[what];
    try {
      await navigator.clipboard.writeText(words);
      said(COPIED[what] ? `Copied ${COPIED[what]}.` : words.includes("\n") ? "Copied the command; it writes its spec, marker.toml, first." : `Copied: ${words}`);
    } catch {
      said(`Copy this: ${words}`);
    }
  } catch (error) {
    told(error);
  }
}

/* --- begin --------------------------------------------------------------------------------------------------------- */

const typing = ({ target }) => /^(INPUT|TEXTAREA|SELECT)$/.test(target.tagName) && target.type !== "checkbox";

function listen() {
  const undo = () => drawing.back() || travel(past, future);
  by("undo").addEventListener("click", undo);
  by("redo").addEventListener("click", () => travel(future, past));
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || typing(event)) return;
    const key = event.key.toLowerCase();
    if (key === "z") event.shiftKey ? travel(future, past) : undo();
    else if (key === "y") travel(future, past);
    else return;
    event.preventDefault();
  });
  by("optimize").addEventListener("click", ({ detail }) => {
    if (detail > 1) return null;
    if (!search) return optimize();
    search.abort();
    return said("Stopped; the dots are as they were before the search.");
  });
  by("back").addEventListener("click", () => become(options.shape ? flat : options, Boolean(options.shape)));
  by("open").addEventListener("click", () => by("files").click());
  by("files").addEventListener("change", async () => {
    await take([...by("files").files]);
    by("files").value = "";
  });
  by("download").addEventListener("click", download);
  by("copies").append(...Object.entries(COPIES).map(([id, name]) => make("button", { id, type: "button", popovertarget: "copies", popovertargetaction: "hide", click: () => copy(id) }, name)));
  by("sheet").addEventListener("toggle", page);
  // Each answer makes another marker of as many dots.
  const anew = async (change) => {
    const { points, ...others } = sizeless(options);
    return (await become({ ...others, ...(points && { n: look.dots.length }), ...change })) && optimize();
  };
  by("first-paper").addEventListener("change", () => anew({ paper: by("first-paper").value, boundary: "page", radius: undefined, drawing_center: undefined }));
  by("first-camera").addEventListener("change", ({ target: { value } }) => {
    if (value !== "file") return anew({ camera: value || undefined, camera_covariance: undefined });
    by("files").click();
    return fill();
  });
  by("first-far").addEventListener("change", ({ target: { valueAsNumber: far } }) => {
    const range = far > 0 ? `${Number((NEAREST * far).toPrecision(4))}..${far}` : far;
    anew({ poses: Number.isNaN(far) ? undefined : `cone:distance=${range}m,tilt=0..${TILT}` });
  });
  by("theme").addEventListener("change", () => {
    if (by("theme").value) document.documentElement.dataset.theme = by("theme").value;
    else delete document.documentElement.dataset.theme;
    try { localStorage.theme = by("theme").value; } catch { /* not kept */ }
  });
  for (const button of by("modes").querySelectorAll("[data-mode]")) button.addEventListener("click", () => pick(button.dataset.mode));
  by("clear").addEventListener("click", () => {
    const { keep_out, boundary, drawing_center, ...others } = options, typed = keepOuts().filter((each) => !isDrawn(each));
    become({ ...others, ...(typed.length && { keep_out: typed }), ...(isDrawn(boundary) ? pageRoom() : { boundary, drawing_center }) });
  });
  by("table").addEventListener("toggle", () => by("table").open && look && numbers(look));
  by("skip").addEventListener("click", (event) => {
    // The address holds the design.
    event.preventDefault();
    by("marker").focus();
  });
  by("find").addEventListener("input", () => said(fields.find(by("find").value) ? "" : "No option is called that, nor says so."));
  by("calibrate").addEventListener("click", () => calibrate(seen, searching).catch(told));
  by("photos-away").addEventListener("click", () => {
    away();
    by("open").focus();
  });
  by("form").addEventListener("submit", (event) => event.preventDefault());
  by("template").addEventListener("change", () => {
    const chosen = known.templates.find((each) => each.name === by("template").value);
    by("template").value = "";
    if (chosen) become({ ...(chosen.shape && { shape: chosen.shape }), ...chosen.options });
  });
  by("rig").addEventListener("submit", (event) => {
    event.preventDefault();
    const shape = by("shape").value.trim() || "cube", edge = by("edge").value.trim();
    // Of a rig that is there, the other options are kept.
    const { shape: last, edge: old, ...others } = options.shape ? options : {};
    become({ ...others, shape, ...(edge && !shape.startsWith("wall") && !shape.startsWith("pair") && { edge }) });
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
    become(state).then((taken) => taken && said("The design of the link."));
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
  fit();
  drawing = editor(by("canvas"), {
    moving: (dots) => { before ??= JSON.stringify(options); options = placed(dots); refresh(); },
    stayed: () => {
      if (before) options = JSON.parse(before);
      before = null;
      refresh();
    },
    shifted: (index, by) => region({ move: { index, by } }),
    dropped: (index) => become({ ...options, keep_out: keepOuts().filter((_, each) => each !== index) }),
    moved: (dots) => {
      const next = placed(dots);
      if (before) options = JSON.parse(before);
      before = null;
      become(next);
    },
    drawn,
    said,
  });
  numbers = facts.numbers(by("table").querySelector(".scroll"), (index, place) => drawing.set(index, place), (index) => drawing.remove(index));
  take = files({ options: () => options, become, stand, seen, said, told }, known.units);
  by("first-paper").append(...known.papers.map((name) => make("option", {}, name)));
  by("first-paper").value = known.paper;
  by("suffix").append(...known.formats.map((each) => make("option", { value: each.suffix, title: each.words }, each.suffix)));
  by("template").append(make("option", { value: "" }, "a template …"), ...known.templates.map((each) => make("option", { value: each.name }, `${each.name}: ${each.title}`)));
  listen();
  pick("move");
  const linked = location.hash.length > 1, state = read(location.hash);
  if (state?.shape) await refresh();
  // Who has nothing yet begins with the page in the printer.
  await become(state || (known.file === null ? { boundary: "page", paper: known.paper } : {}), false);
  if (linked && !state) said("The address holds no design; this is a new one.", true);
  // As if it were opened here.
  if (known.file === null && !linked) optimize();
  else if (!linked) await take([new File([await (await ask("file")).blob()], known.file)]);
  begun = true;
  by("main").setAttribute("aria-busy", String(Boolean(running)));
}

begin();
