/* The form of all options, made from what the library declares. */

import { make } from "./dom.js";

const OPEN = ["Layout", "Camera and poses", "Dots and labels"];

/* Fill a form; change(name, value) is called with text, a boolean, a list, or null for the default. */
export function form(element, known, change) {
  const fields = {};
  for (const group of known.groups) {
    const body = group.options.map((option) => {
      const field = control(option, known.choices[option.name], (value) => change(option.name, value));
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
    refuse(line) {
      for (const [name, field] of Object.entries(fields)) field.refuse(line.includes(`${name}=`) || line.includes(` ${name}:`));
    },
    find(text) {
      const wanted = text.trim().toLowerCase();
      for (const field of Object.values(fields)) field.row.hidden = !field.words.includes(wanted);
      for (const group of element.querySelectorAll("details")) {
        group.hidden = ![...group.querySelectorAll(".option")].some((row) => !row.hidden);
        if (wanted) group.open = true;
      }
    },
  };
}

function control(option, choices, change) {
  const id = `option-${option.name}`, help = `${id}-help`;
  const common = { id, "aria-describedby": help };
  const list = choices && `${id}-list`;
  let input, own = "";
  if (option.kind === "bool") {
    input = make("input", { ...common, type: "checkbox", change: () => change(input.checked === Boolean(option.default) ? null : input.checked) });
  } else {
    input = make("input", {
      ...common, list, autocomplete: "off", spellcheck: "false", placeholder: option.shown || option.metavar || "",
      change: () => {
        const text = input.value.trim();
        own = input.value;
        change(!text ? null : option.repeatable ? text.split(/\s*\|\s*/) : text);
      },
    });
  }
  const note = make("span", {});
  const row = make("div", { class: "option", title: option.help },
    make("label", { for: id }, option.flag.replace(/^--/, "").replaceAll("-", " "), note), input,
    list && make("datalist", { id: list }, choices.map((value) => make("option", { value }))),
    make("p", { class: "note", id: help }, option.help, option.repeatable ? " Several are separated by |." : ""));
  return {
    row, words: `${option.name} ${option.flag} ${option.help}`.toLowerCase(),
    show(value, placeholder) {
      const given = value !== undefined && value !== null;
      row.classList.toggle("set", given);
      if (option.kind === "bool") {
        input.checked = given ? value : Boolean(option.default);
        return;
      }
      const values = !given ? [] : option.repeatable ? [value].flat() : [value], typed = values.filter((each) => typeof each !== "object");
      const others = values.length - typed.length;
      note.textContent = !others ? "" : option.repeatable ? `${typed.length ? "and " : ""}${others} drawn or from a file` : "drawn or from a file";
      input.placeholder = !others ? placeholder || option.shown || option.metavar || "" : option.repeatable ? "type to add some" : "type to replace it";
      // What is being typed is not overwritten.
      if (input !== document.activeElement || input.value === own) input.value = own = typed.join(" | ");
    },
    refuse(wrong) {
      if (wrong) {
        input.setAttribute("aria-invalid", "true");
        row.closest("details").open = true;
      } else input.removeAttribute("aria-invalid");
    },
  };
}
