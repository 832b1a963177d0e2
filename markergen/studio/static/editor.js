/* The marker as a drawing: dots to drag, add and take away by mouse, touch and keyboard, and regions to draw.

editor(element, hooks) returns {draw(look), ghost(points), mode(name), dots()}. Lengths are in m, y is up.
hooks.moving(dots): a dot is on its way; hooks.moved(dots): it is in its place, or dots were added or taken away;
hooks.drawn(mode, shape): a region was drawn, a circle or polygon as in a marker.json; hooks.said(text): what to tell. */

import { make, mm } from "./dom.js";

const STEP = 1e-3, FINE = 1e-4, COARSE = 1e-2;

/* What is drawn is in hundredths of a mm. */
const grid = (meters) => Number(meters.toFixed(5));

export function editor(element, hooks) {
  const svg = make("svg", { role: "group", "aria-label": "Marker, seen from the front; Tab goes from dot to dot", preserveAspectRatio: "xMidYMid meet" });
  const floor = make("g"), layer = make("g"), over = make("g", { "aria-hidden": "true" });
  svg.append(floor, layer, over);
  element.append(svg);
  let seen = null, dots = [], mode = "move", extent = 0.2, held = null, draft = [], round = 0, shapes = [];

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
    const all = [...seen.room.outlines, ...(seen.room.keep_outs || []).flat()].flat();
    const far = Math.max(...all.flatMap(([x, y]) => [Math.abs(x), Math.abs(y)]), seen.room.radius || 0.01);
    extent = far * 1.12;
    svg.setAttribute("viewBox", `${-extent} ${-extent} ${2 * extent} ${2 * extent}`);
    const width = extent / 250;
    floor.replaceChildren(
      make("path", { class: "room", d: d(seen.room.outlines), "fill-rule": "evenodd", "stroke-width": width }),
      ...[...(seen.room.keep_outs || []), ...(seen.room.holes || [])].map((rings) => make("path", { class: "out", d: d(rings), "stroke-width": width })),
      make("line", { class: "axis", x1: -extent / 14, x2: extent / 7, y1: 0, y2: 0, "stroke-width": width }),
      make("line", { class: "axis", y1: extent / 14, y2: -extent / 7, x1: 0, x2: 0, "stroke-width": width }),
      make("text", { class: "axis-text", x: extent / 6.5, y: extent / 60, "font-size": extent / 22 }, "x"),
      make("text", { class: "axis-text", x: -extent / 90, y: -extent / 6.5, "font-size": extent / 22 }, "y"));
    const tag = seen.room.tag;
    if (tag) {
      const [x, y] = tag.center, half = tag.side / 2;
      floor.append(make("rect", { class: "mark", x: x - half, y: -y - half, width: tag.side, height: tag.side }),
        make("text", { x, y: -y, fill: "#fff", "text-anchor": "middle", "dominant-baseline": "central", "font-size": tag.side / 9 }, tag.name));
    }
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
      pointerdown: (event) => {
        if (event.button) return;
        if (mode === "remove") remove(index);
        if (mode !== "move") return;
        held = { index, at: point(event), from: { ...dots[index] }, moved: false };
        group.focus({ preventScroll: true });
        svg.setPointerCapture(event.pointerId);
        event.preventDefault();
      },
      keydown: (event) => keys(event, index),
    }, parts.halo, parts.disk, parts.hole, parts.label);
    return { group, ...parts };
  }

  function keys(event, index) {
    const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (ways[event.key]) {
      const step = event.altKey ? FINE : event.shiftKey ? COARSE : STEP, dot = dots[index];
      dots[index] = { ...dot, x: dot.x + ways[event.key][0] * step, y: dot.y + ways[event.key][1] * step };
      event.preventDefault();
      place();
      hooks.moved(dots);
    } else if (["Delete", "Backspace", ...(mode === "remove" ? ["Enter", " "] : [])].includes(event.key)) {
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

  svg.addEventListener("pointermove", (event) => {
    if (held) {
      const [x, y] = point(event), { index, at, from } = held;
      held.moved = true;
      dots[index] = { ...dots[index], x: from.x + x - at[0], y: from.y + y - at[1] };
      place();
      hooks.moving(dots);
    } else if (draft.length === 1 && event.buttons) circle(point(event));
    else if (draft.length) sketch([...draft, point(event)]);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    svg.addEventListener(name, () => {
      if (held?.moved) hooks.moved(dots);
      held = null;
      if (round && name === "pointerup") finish();
    });
  }
  svg.addEventListener("pointerdown", (event) => {
    if (event.button || !seen) return;
    const [x, y] = point(event);
    if (mode === "add") {
      dots = [...dots, { ...dots.at(-1), x, y, kind: "dot" }];
      place();
      hooks.moved(dots);
    } else if (mode === "room" || mode === "keep") {
      const [first] = draft;
      if (first && draft.length > 2 && Math.hypot(first[0] - x, first[1] - y) < extent / 25) finish();
      else sketch((draft = [...draft, [x, y]]));
      svg.setPointerCapture(event.pointerId);
    }
  });
  svg.addEventListener("dblclick", () => draft.length && finish());
  document.addEventListener("keydown", (event) => {
    if (!draft.length) return;
    if (event.key === "Enter") finish();
    if (event.key === "Escape") sketch((draft = []));
  });

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

  /* Two corners are those of a rectangle. */
  function finish() {
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
    sketch((draft = []));
    return outline.length > 2 ? hooks.drawn(mode, { kind: "polygon", outlines: [outline] })
      : hooks.said("A region needs three corners, or two opposite ones of a rectangle.");
  }

  return {
    /* Show a look; a dot that is held keeps its place. */
    draw(look) {
      seen = look;
      const own = held && dots[held.index];
      dots = look.dots.map((dot) => ({ ...dot }));
      if (own && held.index < dots.length) dots[held.index] = { ...dots[held.index], x: own.x, y: own.y };
      scene();
      place();
    },
    /* Show layouts of a search beside the dots; none clears them. */
    ghost(points) {
      over.replaceChildren(...points.map(([x, y]) => make("circle", { class: "ghost", cx: x, cy: -y, r: Math.max((dots[0]?.diameter || 0) / 2, extent / 90) })));
    },
    mode(name) {
      mode = name;
      sketch((draft = []));
      svg.classList.toggle("drawing", name !== "move" && name !== "remove");
    },
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
