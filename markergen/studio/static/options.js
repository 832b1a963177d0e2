/* The form of all options, made from what the library declares. */

import { label, make, worded } from "./dom.js";

/* On a phone the marker is next to the questions that come first. */
const OPEN = matchMedia("(max-width: 48rem)").matches ? [] : ["Layout", "Camera and poses", "Dots and labels"];
const FILES = ["camera", "poses", "covariance"];
/* Options that take nothing but one of their choices, and examples of those without a default. */
const CLOSED = ["orientation", "noise_model", "coordinates", "process"];
const EXAMPLES = {
  "ERROR@LENGTH": "0.1deg@1.5m", "X,Y;...|FILE.csv": "0mm,50mm; -40mm,-30mm; …", "SHAPE|FILE": "rect:200mmx100mm", "SHAPE|FILE[#LAYER]": "circle:5mm@30mm,0mm",
  WxH: "640x480", LIST: "0-9", mount: "4xM4@100mm", dowel: "2x4mm@130mm", FACE: "-z",
};
/* Other names of what an option is for. */
const ALSO = { mount: "bore drill screw bolt", dowel: "bore drill pin", keep_out: "keep-out hole", n: "count", dot: "size", poses: "distance tilt angle" };

/* Lengths without a unit are in mm; in shapes, places and holes all numbers but a count, which stands first, angles, and what follows a letter. */
const BARE = { length: /^()(\d+\.?\d*|\.\d+)$/, places: /(^(?![^x]*x)|[:@,;x]\s*)([-+]?(?:\d+\.?\d*|\.\d+))(?=\s*(?:[,;:@x/]|$))/g };
const withUnits = (text, kind) => (/^(length|shape|layout|texts)/.test(kind) ? text.replace(BARE[kind.startsWith("length") ? "length" : "places"], "$1$2mm") : text);
const plain = (text) => ` ${text.toLowerCase().replaceAll(/[^a-z0-9]+/g, " ").trim()}`;

/* Fill a form with groups of options; change(name, value) is called with text, a boolean, a list, or null for the default. */
export function form(element, groups, change) {
  const fields = {};
  element.replaceChildren();
  for (const group of groups) {
    const body = group.options.map((option) => {
      const field = control(option, (value) => change(option.name, value));
      fields[option.name] = field;
      return field.row;
    });
    element.append(make("details", { open: OPEN.includes(group.name) }, make("summary", {}, group.name), body));
  }
  return {
    /* Show the values of a state; what is not plain text is named instead. */
    show(options, shown = {}) {
      for (const [name, field] of Object.entries(fields)) field.show(options[name], shown[name]);
    },
    /* Mark the fields that an error names or whose text it quotes; those that its remedy names if there are none. */
    refuse({ expected = "", found = "", remedy = "" } = {}, message = "") {
      const every = Object.values(fields), wrong = every.filter((field) => field.named(`${expected} ${found}`) || field.quoted(found));
      const marked = wrong.length ? wrong : every.filter((field) => field.named(remedy));
      for (const field of every) field.refuse(marked.includes(field), message);
      return marked.map((field) => field.name);
    },
    /* Labels and values of a state, for paper. */
    told: (options) => Object.entries(fields).filter(([name]) => options[name] !== undefined).map(([name, field]) => field.told(options[name])),
    /* Show the options that have a word; returns whether there are any. */
    find(text) {
      const wanted = plain(text);
      for (const field of Object.values(fields)) field.row.hidden = !field.words.includes(wanted);
      for (const group of element.querySelectorAll("details")) {
        group.hidden = ![...group.querySelectorAll(".option")].some((row) => !row.hidden);
        if (wanted.trim()) group.open = true;
      }
      return Object.values(fields).some((field) => !field.row.hidden);
    },
  };
}

/* Whether a value can be typed. */
const typed = (value) => typeof value !== "object" || (Array.isArray(value) && value.every((each) => typeof each === "string"));

function control(option, change) {
  const id = `option-${option.name}`, help = `${id}-help`, usual = worded(option.shown || EXAMPLES[option.name] || EXAMPLES[option.metavar] || option.metavar || ""), meant = worded(option.help);
  const common = { id, "aria-describedby": help };
  const { choices } = option, list = choices.length ? `${id}-list` : undefined;
  let input, own = "";
  if (option.kind === "bool") {
    input = make("input", { ...common, type: "checkbox", change: () => change(input.checked === Boolean(option.default) ? null : input.checked) });
  } else if (CLOSED.includes(option.name)) {
    input = make("select", { ...common, change: () => change(input.value || null) }, ["", ...choices].map((value) => make("option", { value }, value || usual)));
  } else {
    input = make("input", {
      ...common, list, autocomplete: "off", spellcheck: "false", placeholder: usual, inputmode: { int: "numeric", float: "decimal" }[option.kind],
      change: () => {
        const parts = input.value.trim().replace(/^\+(?=[\d.])/, "").split(/\s*\|\s*/).map((part) => withUnits(part, option.kind));
        const text = own = input.value = parts.join(" | ");
        change(!text ? null : option.repeatable ? parts : text);
      },
    });
  }
  const note = make("span", {}), fault = make("p", { class: "fault", role: "alert", hidden: true });
  const row = make("div", { class: "option", title: meant },
    make("label", { for: id }, label(option.flag), note), input, fault,
    FILES.includes(option.kind) ? make("button", { type: "button", click: () => document.getElementById("files").click() }, "File…") : null,
    list && make("datalist", { id: list }, choices.map((value) => make("option", { value }))),
    make("p", { class: "note", id: help }, meant, option.repeatable ? " Several are separated by |." : ""));
  // In errors it is --print-sigma, print_sigma=, or print_sigma: where several are listed.
  const names = new RegExp(`${option.flag}(?![\\w-])|\\b${option.name}(=|:|s?\\[\\d+\\]:)`);
  return {
    name: option.name,
    named: (text) => names.test(text),
    // A part of a value is written as it is there: distance=0 m.
    quoted: (text) => input.value.split("|").some((each) => each.trim() && text.includes(`'${each.trim()}'`)) || (/=/.test(text) && input.value.includes(text.split(" ")[0])),
    told: (value) => [label(option.flag), typed(value) ? [value].flat().join(" | ") : JSON.stringify(value).replaceAll('"', "").replaceAll(/[:,]/g, "$& ")],
    row, words: plain(`${label(option.flag)} ${option.name} ${option.help} ${ALSO[option.name] || ""}`),
    show(value, placeholder) {
      const given = value !== undefined && value !== null;
      row.classList.toggle("set", given);
      if (option.kind === "bool") {
        input.checked = given ? value : Boolean(option.default);
        return;
      }
      const values = !given ? [] : option.repeatable ? [value].flat() : [value], words = values.filter((each) => typeof each !== "object");
      const others = values.length - words.length;
      note.textContent = !others ? "" : option.repeatable ? `${words.length ? "and " : ""}${others} drawn or from a file` : "drawn or from a file";
      const usually = !others ? placeholder || usual : option.repeatable ? "type to add some" : "type to replace it";
      if (input.options) input.options[0].textContent = usually;
      else input.placeholder = usually;
      // What is being typed is not overwritten.
      if (input !== document.activeElement || input.value === own) input.value = own = words.join(" | ");
    },
    refuse(wrong, message) {
      fault.hidden = !wrong;
      fault.textContent = message;
      if (wrong) {
        input.setAttribute("aria-invalid", "true");
        row.closest("details").open = true;
      } else input.removeAttribute("aria-invalid");
    },
  };
}
