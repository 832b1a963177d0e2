/* Elements, numbers with units, and requests to the studio's server. */

const SVG = new Set(["svg", "g", "path", "circle", "text", "rect", "line", "title", "polyline"]);

/* An element with attributes and children; functions become listeners, undefined and false are left out. */
export function make(name, attributes = {}, ...children) {
  const each = SVG.has(name) ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (typeof value === "function") each.addEventListener(key, value);
    else if (value !== undefined && value !== false) each.setAttribute(key, value === true ? "" : value);
  }
  each.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return each;
}

export const by = (id) => document.getElementById(id);

/* Say in the header what happens, or what went wrong. */
export function said(text, fault = false) {
  by("said").textContent = text;
  by("said").classList.toggle("fault", fault);
}

const LABELS = {
  "--n": "number of dots", "--points": "places of dots", "--target": "error to reach", "--radius": "radius of the room", "--boundary": "shape of the room",
  "--keep-out": "regions without dots", "--relief": "height of pillars", "--poses": "camera poses", "--noise-model": "noise of dots", "--image-noise": "image quality",
  "--print-sigma": "print error", "--scale-sigma": "scale error", "--dot": "dot diameter", "--clearance": "gap around dots", "--gap": "gap between dots",
  "--asymmetric": "labels by the layout, px", "--ids": "ids of a family", "--tile": "several pages", "--edge": "edge of the plate", "--survive": "dots that may be lost",
  "--restarts": "starts of the search", "--mount": "mounting holes", "--dowel": "holes for dowel pins", "--outline": "outline of the plate",
};

/* The label of the field of an option such as --print-sigma. */
export const label = (flag) => LABELS[flag] || flag.replace(/^--/, "").replaceAll("-", " ");

/* Text about options of the command in the words of the page, which has fields. */
export const worded = (text) => text.replace(/markergen (?:design|rig) (?=--)/g, "").replace(/(--\S+ \S+) (?=--)/g, "$1, ").replace(/--[a-z][a-z-]*/g, (flag) => `\u201c${label(flag)}\u201d`);

/* An error of the command likewise. */
const refusal = (line) => worded(line)
  .replace(/^expected options of markergen\.\w+, found/, "expected values that the fields take, found")
  // Bare numbers have become mm.
  .replace(/0\.15 or (?=\S?150mm)/, "").replace(" (a bare number is meters)", "")
  .replace(/see help\(.*\)$/, "each field says what it takes");

export const capital = (line) => `${line[0].toUpperCase()}${line.slice(1)}`;
export const sentence = (line) => worded(`${capital(line)}.`);

/* Have the browser save a file. */
export function save(blob, name) {
  const link = make("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1e4);
}

/* Significant digits; a word for what is missing or not finite. */
export function digits(value, count = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "unbounded";
  if (value === 0) return "0";
  const text = value.toPrecision(count);
  return text.includes("e") ? String(Number(text)) : text;
}

export const mm = (meters, places = 2) => (1e3 * meters).toFixed(places).replace("-0.00", "0.00");

/* Table with a caption; the rows' first cells are their heads; `own` marks a row by its index. */
export function table(caption, header, rows, own = -1) {
  return make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": caption },
    make("table", {}, make("caption", {}, caption),
      make("thead", {}, make("tr", {}, header.map((cell) => make("th", { scope: "col" }, cell)))),
      make("tbody", {}, rows.map((row, index) => make("tr", { class: index === own && "own" },
        row.map((cell, column) => make(column ? "td" : "th", column ? {} : { scope: "row" }, cell)))))));
}

/* What the server refused; `found` is what the command would have said. */
export class Refused extends Error {
  constructor(found) {
    super(refusal(found.line));
    this.found = found;
  }
}

/* The server does not answer. */
export class Gone extends Error {}

export async function ask(path, body, { signal, headers, method } = {}) {
  const blob = body instanceof Blob;
  let answer;
  try {
    answer = await fetch(path, {
      method: method || (body === undefined ? "GET" : "POST"), signal,
      headers: { ...(body !== undefined && !blob ? { "Content-Type": "application/json" } : {}), ...headers },
      body: body === undefined || blob ? body : JSON.stringify(body),
    });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Gone();
  }
  if (answer.ok) return answer;
  let found = { line: `the studio answered with status ${answer.status}` };
  try {
    found = await answer.json();
  } catch { /* no JSON: the status says it */ }
  throw new Refused(found);
}

/* Lines of JSON as they come in. */
export async function* lines(path, body, signal) {
  const reader = (await ask(path, body, { signal })).body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { value, done } = await reader.read();
    rest += value || "";
    const parts = rest.split("\n");
    rest = parts.pop();
    for (const part of parts) if (part) yield JSON.parse(part);
    if (done) return;
  }
}
