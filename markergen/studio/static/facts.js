/* The right side: what to expect of a layout, what limits it, and what stands beside it. */

import { by, digits, make, mm, sentence, table, worded } from "./dom.js";

const MOST = 5;
const SOURCES = { image: "image", print: "print", calibration: "calibration" };

/* Whole percents that add up to 100: the largest takes what the others leave. */
function percents(shares) {
  const whole = shares.map((share) => Math.round(100 * share)), largest = whole.indexOf(Math.max(...whole));
  whole[largest] += 100 - whole.reduce((sum, each) => sum + each, 0);
  return whole;
}

/* What follows a dot that is dragged. */
export function now(look) {
  const { expected, objective, poses } = look, hardest = expected.hardest;
  const over = expected.dropped ? `${expected.poses} of ${expected.poses + expected.dropped} poses, which see the whole marker` : "all poses";
  by("expect").replaceChildren(
    make("p", { class: "big" },
      make("span", { id: "degrees" }, expected.rotation, make("small", {}, `rotation to plan with, RMS of ${over}`)),
      make("span", { id: "millimeters" }, expected.translation, make("small", {}, `position to plan with, RMS of ${over}`))),
    ...(expected.missed ? [make("p", {}, sentence(expected.missed))] : []),
    make("div", { class: "note", id: "plan" }, make("p", {}, `Hardest: ${hardest.rotation} at a tilt of ${hardest.tilt} deg and ${hardest.distance} m.`.replaceAll("..", " to "))));
  by("brief").textContent = `Plan with ${expected.rotation} and ${expected.translation}`;
  const squares = poses.rotation.map((value) => (value === null ? 0 : value * value));
  const total = squares.reduce((sum, value) => sum + value, 0) || 1;
  const shares = Object.keys(SOURCES).map((name) => poses[name].reduce((sum, share, pose) => sum + (share || 0) * squares[pose], 0) / total);
  const bar = make("div", { class: "shares", "aria-hidden": "true" }, shares.map(() => make("i")));
  shares.forEach((share, index) => { bar.children[index].style.width = `${100 * share}%`; });
  by("limits").replaceChildren(bar,
    make("p", { class: "keys" }, Object.values(SOURCES).map((name, index) => make("span", { class: "key" }, `${name} ${percents(shares)[index]} %`))),
    ...look.limits.map((line) => make("p", {}, worded(line))));
  const value = (number) => (number === null ? "does not fit" : `${digits(number, 4)} ${objective.unit}`);
  const worse = objective.ngon && !look.problems.length ? 100 * (objective.value / objective.ngon - 1) : null;
  const said = worse === null ? "" : Math.abs(worse) < 0.05 ? " The same as the regular polygon." : ` ${digits(Math.abs(worse), 2)} % ${worse > 0 ? "above" : "below"} the regular polygon.`;
  by("beside").replaceChildren(
    table(`Objective: ${objective.name}`, ["layout", "value"], [["this layout", value(objective.value)], ["regular polygon", value(objective.ngon)], ["best so far", objective.best_known === null ? "none yet" : value(objective.best_known)]], 0),
    make("p", { class: "note" }, said.trim()), make("div", { id: "patterns" }));
}

/* What is wrong with the layout; of many only the first. */
export function problems(found) {
  const more = found.length - MOST;
  by("problems").replaceChildren(
    ...found.slice(0, MOST).map((each) => make("li", {}, sentence(each.line))),
    ...(more > 0 ? [make("li", {}, `And ${more} more.`)] : []));
}

/* What takes longer; null while it is not known. */
export function later(more) {
  const wait = () => [make("p", { class: "note" }, "Computing; this takes seconds, or minutes for many dots and large images …")];
  by("warnings").replaceChildren(...(more?.warnings || []).map((line) => make("li", {}, sentence(line))));
  if (!more) {
    for (const id of ["counts", "labels", "advice"]) by(id).replaceChildren(...wait());
    by("patterns")?.replaceChildren();
    return;
  }
  const [planned, hardest, ...checks] = more.plan;
  by("plan").replaceChildren(make("p", {}, planned), make("p", {}, hardest),
    ...(checks.length ? [make("details", {}, make("summary", {}, "Where first order does not hold"), checks.map((line) => make("p", {}, line)))] : []));
  by("counts").replaceChildren(...(more.more_dots.length
    ? [table("Expected error of other numbers of dots, same room and print", ["dots", "size", "rotation", "position"],
      more.more_dots.map((row) => [String(row.n), `${mm(row.diameter, 1)} mm`, `${digits(row.rotation_deg)} deg`, `${digits(row.translation_mm)} mm`])),
      make("p", { class: "note" }, worded("With --n auto, a search takes the fewest whose error is within 5 % of the least."))]
    : [make("p", { class: "note" }, "Not computed for a relief.")]));
  by("labels").replaceChildren(make("p", {}, more.labels ? sentence(more.labels.sentence) : "Bare points are not labeled."));
  by("patterns").replaceChildren(...(more.beside.length
    ? [table("Least rotation error that the whole image allows, exact print", ["pattern", "bound"], more.beside.map((row) => [row.name, `${digits(row.rotation_deg)} deg`]), 0)] : []),
    make("p", {}, sentence(more.bound)));
  by("advice").replaceChildren(...(more.advice.length ? more.advice.map((line) => make("p", {}, sentence(line))) : [make("p", { class: "note" }, "None.")]));
}

export function failed(line) {
  by("warnings").replaceChildren();
  for (const id of ["counts", "labels", "advice"]) by(id).replaceChildren(make("p", { class: "note" }, line));
}

/* The dots as numbers to type; returns a function that shows a look. set(index, place) and remove(index) are called. */
export function numbers(element, set, remove) {
  let axes = "", rows = [];

  const row = (index) => {
    const cells = Object.fromEntries([...axes].map((axis) => [axis, make("input", { inputmode: "decimal", "aria-label": `${axis} of dot ${index} in mm` })]));
    const parts = { cells, head: make("th", { scope: "row" }), size: make("td"), taken: make("button", { type: "button", "aria-label": `Remove dot ${index}`, click: () => remove(index) }, "Remove") };
    for (const [axis, cell] of Object.entries(cells)) {
      cell.addEventListener("change", () => {
        const value = Number(cell.value);
        if (Number.isFinite(value) && cell.value.trim()) set(index, { [axis]: value / 1e3 });
        else cell.value = parts.shown[axis];
      });
    }
    parts.row = make("tr", {}, parts.head, [...axes].map((axis) => make("td", {}, cells[axis])), parts.size, make("td", {}, parts.taken));
    return parts;
  };

  const build = (count) => {
    const focus = rows.findIndex((each) => each.taken === document.activeElement);
    rows = Array.from({ length: count }, (_, index) => row(index));
    element.replaceChildren(make("table", {},
      make("thead", {}, make("tr", {}, ["dot", ...[...axes].map((axis) => `${axis} mm`), "size mm", "remove"].map((head) => make("th", { scope: "col" }, head)))),
      make("tbody", {}, rows.map((each) => each.row))));
    if (focus >= 0) rows[Math.min(focus, count - 1)].taken.focus();
  };

  // Only values change as long as the dots are as many: what has the focus keeps it.
  return (look) => {
    const wanted = look.options.relief ? "xyz" : "xy";
    if (wanted !== axes || rows.length !== look.dots.length) {
      axes = wanted;
      build(look.dots.length);
    }
    look.dots.forEach((dot, index) => {
      const { cells, head, size } = rows[index], shown = Object.fromEntries([...axes].map((axis) => [axis, mm(dot[axis])]));
      head.textContent = `${index}${dot.kind === "ring" ? " ring" : ""}`;
      size.textContent = mm(dot.diameter, 1);
      for (const axis of axes) if (rows[index].shown?.[axis] !== shown[axis] || document.activeElement !== cells[axis]) cells[axis].value = shown[axis];
      rows[index].shown = shown;
    });
  };
}
