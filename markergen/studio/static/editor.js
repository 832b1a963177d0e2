/* The marker as a drawing: dots to drag, add and take away by mouse, touch and keyboard, and regions to draw.

editor(element, hooks) returns {draw(look), ghost(points), mode(name), dots()}. Lengths are in m, y is up.
hooks.moving(dots): a dot is on its way; hooks.moved(dots): it is in its place, or dots were added or taken away;
hooks.stayed(): the dot on its way has been let go; hooks.shifted(index, by) and hooks.dropped(index): a keep-out was
moved or taken away; hooks.drawn(mode, shape): a region was drawn, a circle or polygon as in a marker.json; the promise
of whether it can be one; hooks.said(text): what to tell. */

import { make, mm } from "./dom.js";

const STEP = 1e-3, FINE = 1e-4, COARSE = 1e-2;

/* What is drawn is in hundredths of a mm. */
const grid = (meters) => Number(meters.toFixed(5));
const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/* How far an arrow key goes, x and y in m; null for other keys. */
const stride = (event) => WAYS[event.key]?.map((way) => way * (event.altKey ? FINE : event.shiftKey ? COARSE : STEP)) || null;

export function editor(element, hooks) {
  const svg = make("svg", { role: "group", "aria-label": "Marker, seen from the front; Tab goes from dot to dot", preserveAspectRatio: "xMidYMid meet" });
  const floor = make("g"), regions = make("g"), axes = make("g", { "aria-hidden": "true" }), layer = make("g"), over = make("g", { "aria-hidden": "true" }), sight = make("g", { "aria-hidden": "true" });
  svg.append(floor, regions, axes, layer, over, sight);
  element.append(svg);
  let seen = null, dots = [], mode = "move", extent = 0.2, held = null, draft = [], round = 0, shapes = [], outs = [], closing = false, cross = [0, 0];

  const drawing = () => mode === "room" || mode === "keep";

  const point = (event) => {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [grid(at.x), grid(-at.y)];
  };
  const d = (rings) => rings.map((ring) => `M${ring.map(([x, y]) => `${x},${-y}`).join("L")}Z`).join("");
  const faults = () => new Set(seen.problems.flatMap((each) => each.dots));

  function named(dot, index) {
    const height = dot.z ? `, ${mm(dot.z)} high` : "";
    return `dot ${index}${dot.kind === "ring" ? ", the key ring" : ""}, at ${mm(dot.x)}, ${mm(dot.y)} mm${height}`;
  }

  function scene() {
    const all = [...seen.room.outlines, ...seen.room.keep_outs.flatMap((each) => each.outlines)].flat();
    const far = Math.max(...[...all, ...dots.map((dot) => [dot.x, dot.y])].flatMap(([x, y]) => [Math.abs(x), Math.abs(y)]), seen.room.radius || 0.01);
    // What is dragged out of the view comes back into it when it is let go.
    if (!held) extent = far * 1.12;
    svg.setAttribute("viewBox", `${-extent} ${-extent} ${2 * extent} ${2 * extent}`);
    const width = extent / 250;
    floor.replaceChildren(
      make("path", { class: "room", d: d(seen.room.outlines), "fill-rule": "evenodd", "stroke-width": width }),
      ...(seen.room.holes || []).map((rings) => make("path", { class: "out", d: d(rings), "stroke-width": width })));
    axes.replaceChildren(
      // Their names stand beyond all dots.
      make("line", { class: "axis", x1: -extent / 14, x2: 0.94 * extent, y1: 0, y2: 0, "stroke-width": width }),
      make("line", { class: "axis", y1: extent / 14, y2: -0.94 * extent, x1: 0, x2: 0, "stroke-width": width }),
      make("text", { class: "axis-text", x: 0.95 * extent, y: extent / 60, "font-size": extent / 22 }, "x"),
      make("text", { class: "axis-text", x: -extent / 90, y: -0.95 * extent, "font-size": extent / 22 }, "y"));
    const tag = seen.room.tag;
    if (tag) {
      const [x, y] = tag.center, half = tag.side / 2;
      floor.append(make("rect", { class: "mark", x: x - half, y: -y - half, width: tag.side, height: tag.side }),
        make("text", { x, y: -y, fill: "#fff", "text-anchor": "middle", "dominant-baseline": "central", "font-size": tag.side / 9 }, tag.name));
    }
  }

  /* The keep-outs, which are dragged and taken away as dots are. */
  function rooms() {
    const given = seen.room.keep_outs, focus = outs.indexOf(document.activeElement);
    if (outs.length !== given.length) {
      outs = given.map((_, index) => make("path", {
        class: "out", tabindex: 0, role: "button", "aria-roledescription": "movable region", "aria-description": "Arrow keys move it, Delete removes it",
        pointerdown: (event) => grab(event, outs[index], { out: index }, () => hooks.dropped(index)),
        keydown: (event) => {
          const step = stride(event);
          if (step) hooks.shifted(index, step);
          else if (removes(event)) hooks.dropped(index);
          else return;
          event.preventDefault();
        },
      }));
      regions.replaceChildren(...outs);
      if (focus >= 0) (outs[Math.min(focus, outs.length - 1)] || element.closest("section"))?.focus();
    }
    given.forEach((each, index) => {
      outs[index].setAttribute("d", d(each.outlines));
      outs[index].setAttribute("stroke-width", extent / 250);
      outs[index].setAttribute("aria-label", `keep-out ${index}, ${each.words}`);
      if (held?.out !== index) outs[index].removeAttribute("transform");
    });
  }

  const removes = (event) => ["Delete", "Backspace", ...(mode === "remove" ? ["Enter", " "] : [])].includes(event.key);

  /* Begin to drag something, or remove it. */
  function grab(event, shape, what, gone) {
    if (event.button) return;
    if (mode === "remove") gone();
    if (mode !== "move") return;
    held = { ...what, at: point(event), moved: false };
    shape.focus({ preventScroll: true });
    svg.setPointerCapture(event.pointerId);
    event.preventDefault();
  }

  /* Leave what is dragged where it was. */
  function release() {
    const { index, from, out } = held;
    held = null;
    if (out !== undefined) return outs[out].removeAttribute("transform");
    dots[index] = from;
    place();
    return hooks.stayed();
  }

  function place() {
    const wrong = faults(), focus = shapes.findIndex((shape) => shape.group === document.activeElement);
    if (shapes.length !== dots.length) {
      shapes = dots.map((dot, index) => shape(index));
      layer.replaceChildren(...shapes.map((each) => each.group));
      if (focus >= 0) shapes[Math.min(focus, shapes.length - 1)]?.group.focus();
    }
    dots.forEach((dot, index) => {
      const { group, halo, disk, hole, label } = shapes[index], radius = Math.max(dot.diameter / 2, extent / 120);
      group.setAttribute("transform", `translate(${dot.x} ${-dot.y})`);
      group.setAttribute("aria-label", named(dot, index));
      group.setAttribute("class", `dot${dot.kind === "ring" ? " ring" : ""}${wrong.has(index) ? " fault" : ""}`);
      disk.setAttribute("r", radius);
      hole.setAttribute("r", dot.kind === "ring" ? radius * ((dot.inner || dot.diameter / 2) / dot.diameter) : 0);
      halo.setAttribute("r", radius + extent / 60);
      halo.setAttribute("stroke-width", extent / 110);
      label.setAttribute("font-size", Math.min(radius * 0.8, extent / 16));
      label.textContent = index;
    });
  }

  function shape(index) {
    const parts = { halo: make("circle", { class: "halo" }), disk: make("circle", { class: "mark" }), hole: make("circle", { class: "hole" }), label: make("text") };
    const group = make("g", {
      tabindex: 0, role: "button", "aria-roledescription": "movable dot", "aria-description": "Arrow keys move it, Delete removes it",
      pointerdown: (event) => grab(event, group, { index, from: { ...dots[index] } }, () => remove(index)),
      keydown: (event) => keys(event, index),
    }, parts.halo, parts.disk, parts.hole, parts.label);
    return { group, ...parts };
  }

  function keys(event, index) {
    const step = stride(event), dot = dots[index];
    if (step) {
      dots[index] = { ...dot, x: dot.x + step[0], y: dot.y + step[1] };
      event.preventDefault();
      place();
      hooks.moved(dots);
    } else if (removes(event)) {
      event.preventDefault();
      remove(index);
    }
  }

  function remove(index) {
    if (dots.length <= 4) return hooks.said("A homography needs four dots: move this one instead.");
    dots = dots.filter((_, each) => each !== index);
    place();
    return hooks.moved(dots);
  }

  function add([x, y]) {
    dots = [...dots, { ...dots.at(-1), x, y, kind: "dot" }];
    place();
    hooks.moved(dots);
  }

  /* Set a corner of a region; the first one once more closes it. */
  function corner([x, y]) {
    const [first] = draft;
    if (first && draft.length > 2 && Math.hypot(first[0] - x, first[1] - y) < extent / 25) finish();
    else sketch((draft = [...draft, [x, y]]));
  }

  svg.addEventListener("pointermove", (event) => {
    if (held) {
      const [x, y] = point(event), { index, at, from, out } = held;
      held.moved = true;
      held.by = [x - at[0], y - at[1]];
      if (out !== undefined) return outs[out].setAttribute("transform", `translate(${held.by[0]} ${-held.by[1]})`);
      dots[index] = { ...dots[index], x: from.x + held.by[0], y: from.y + held.by[1] };
      place();
      return hooks.moving(dots);
    }
    if (closing) return null;
    if (draft.length === 1 && event.buttons) return circle(point(event));
    return draft.length ? sketch([...draft, point(event)]) : null;
  });
  svg.addEventListener("pointerup", () => {
    const done = held;
    held = null;
    if (done?.moved && done.out !== undefined) hooks.shifted(done.out, done.by);
    else if (done?.moved) hooks.moved(dots);
    if (round) finish();
  });
  svg.addEventListener("pointercancel", () => held && release());
  // Or a browser scrolls the page after all, and takes the finger's dot away.
  svg.addEventListener("touchstart", (event) => (held || draft.length) && event.preventDefault(), { passive: false });
  svg.addEventListener("pointerdown", (event) => {
    if (event.button || !seen || closing) return;
    if (mode === "add" || drawing()) cross = point(event);
    if (mode === "add") add(cross);
    else if (drawing()) {
      corner(cross);
      svg.setPointerCapture(event.pointerId);
    }
  });
  svg.addEventListener("dblclick", () => draft.length && finish());
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && held) release();
    if (!draft.length || closing) return;
    if (event.key === "Enter") finish();
    if (event.key === "Escape") sketch((draft = []));
  });

  /* By keyboard a cross goes where the pointer would be. */
  svg.addEventListener("keydown", (event) => {
    if (event.target !== svg || !seen || closing || event.ctrlKey || event.metaKey) return;
    const step = stride(event);
    if (step) {
      cross = cross.map((value, axis) => Math.min(extent, Math.max(-extent, grid(value + step[axis]))));
      hooks.said(`The cross is at ${mm(cross[0])}, ${mm(cross[1])} mm.`);
      if (draft.length) sketch([...draft, cross]);
    } else if (event.key === " " || (event.key === "Enter" && mode === "add")) mode === "add" ? add(cross) : corner(cross);
    else return;
    event.preventDefault();
    aim();
  });
  // Chromium lets Tab go to SVG elements that listen for the focus themselves.
  element.addEventListener("focusin", (event) => event.target === svg && svg.matches(":focus-visible") && aim());
  element.addEventListener("focusout", () => sight.replaceChildren());

  function aim() {
    const [x, y] = cross, long = extent / 16, looks = { class: "cross", "stroke-width": extent / 160 };
    sight.replaceChildren(make("line", { ...looks, x1: x - long, x2: x + long, y1: -y, y2: -y }), make("line", { ...looks, x1: x, x2: x, y1: -y - long, y2: long - y }));
  }

  function sketch(outline) {
    round = 0;
    over.replaceChildren(...(outline.length ? [make("path", { class: "draft", d: d([outline]), "stroke-width": extent / 200 })] : []));
  }

  /* The first corner is a center where the pointer is dragged away from it. */
  function circle([x, y]) {
    const [[cx, cy]] = draft, radius = grid(Math.hypot(x - cx, y - cy));
    round = radius > extent / 25 ? radius : 0;
    over.replaceChildren(...(round ? [make("circle", { class: "draft", cx, cy: -cy, r: round, "stroke-width": extent / 200 })] : []));
  }

  /* Hand a region over; one that cannot be used is kept as it was drawn. Two corners are those of a rectangle. */
  async function finish() {
    if (round) {
      const shape = { kind: "circle", radius: round, center: draft[0] };
      sketch((draft = []));
      return hooks.drawn(mode, shape);
    }
    let outline = draft.filter(([x, y], index) => !index || Math.hypot(x - draft[index - 1][0], y - draft[index - 1][1]) > extent / 500);
    if (outline.length === 2) {
      const [[a, b], [c, e]] = outline;
      outline = [[a, b], [c, b], [c, e], [a, e]];
    }
    if (outline.length < 3) {
      sketch((draft = []));
      return hooks.said("A region needs three corners, or two opposite ones of a rectangle.");
    }
    sketch(outline);
    closing = true;
    const taken = await hooks.drawn(mode, { kind: "polygon", outlines: [outline] }).finally(() => { closing = false; });
    return sketch(taken ? (draft = []) : draft);
  }

  return {
    /* Show a look, of the newest state. */
    draw(look) {
      seen = look;
      dots = look.dots.map((dot) => ({ ...dot }));
      if (held && !(dots[held.index] || look.room.keep_outs[held.out])) held = null;
      scene();
      rooms();
      place();
    },
    /* Show layouts of a search beside the dots; none clears them. */
    ghost(points) {
      over.replaceChildren(...points.map(([x, y]) => make("circle", { class: "ghost", cx: x, cy: -y, r: Math.max((dots[0]?.diameter || 0) / 2, extent / 90) })));
    },
    mode(name) {
      mode = name;
      sketch((draft = []));
      svg.classList.toggle("drawing", name === "add" || drawing());
      if (name === "add" || drawing()) svg.setAttribute("tabindex", 0);
      else svg.removeAttribute("tabindex");
    },
    /* Take back the last corner of a region that is being drawn, if there is one. */
    back() {
      if (!draft.length || closing) return false;
      sketch((draft = draft.slice(0, -1)));
      return true;
    },
    held: () => Boolean(held),
    remove,
    dots: () => dots,
    /* Put one dot to coordinates. */
    set(index, place_) {
      dots[index] = { ...dots[index], ...place_ };
      place();
      hooks.moved(dots);
    },
  };
}
