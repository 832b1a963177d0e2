"use strict";
/* The dome of poses: camera centers over a marker, to turn and to pick from.

dome(element, data, {onpick, value}) fills an empty element of any width from 280 px and returns
{update(data), pick(index), color(value), picked()}: new data for the same dome, and what a page may set, without
onpick. The hardest pose is picked at first, and again when the number of poses changes; -1 picks none.

data, lengths in m; the studio's answer to `look` is of this form, as is what a report holds:
  poses     {x, y, z: [...] centers of the cameras in the frame of the marker or rig;
             rotation: [...] deg, translation: [...] mm, RMS to expect, null where unbounded or nothing is seen;
             image, print, calibration: [...] shares of the rotation's variance, 0 to 1;
             words: [...] more about each pose}; what is missing is not offered
  room      {outlines: rings [[x, y, z]...], z may be left out}
  dots      [{x, y, z, diameter, normal: [x, y, z]}], without a normal that of the marker, [0, 0, 1]
dome.shade(share) and dome.scale(values) are the colors, for other pictures beside it.
value: what the colors show at first, "rotation" unless it says otherwise.  onpick(index): a pose was picked. */

const dome = (() => {
  const SHOWN = {
    rotation: ["rotation error", " deg"], translation: ["translation error", " mm"],
    image: ["share of the image noise", " %"], print: ["share of the print", " %"],
    calibration: ["share of the calibration", " %"],
  };
  const SHARES = ["image", "print", "calibration"], RAD = Math.PI / 180, STEPS = 40, NEAR = 22;
  const COLORS = CSS.supports("color", "light-dark(red, red)");

  const sheet = new CSSStyleSheet();
  sheet.replaceSync(`
    .dome-picture { display: block; width: 100%; touch-action: pan-y; cursor: grab; user-select: none; }
    .dome-picture:focus-visible { outline: 2px solid currentColor; outline-offset: 2px; }
    .dome-controls { display: flex; flex-wrap: wrap; gap: .3rem 1.2rem; align-items: center; margin: .4rem 0 0; }
    .dome-controls label { display: flex; gap: .5rem; align-items: center; flex: 0 1 auto; }
    .dome-controls label.dome-wide { flex: 1 1 14rem; }
    .dome-controls input { flex: 1; min-width: 6rem; }
    .dome-controls :is(input, select) { font: inherit; accent-color: currentColor; min-height: 1.75rem; }
    @media (pointer: coarse) { .dome-controls :is(input, select) { min-height: 44px; } }
    .dome-said { display: block; min-height: 3em; margin: .2rem 0 0; font-variant-numeric: tabular-nums; }
    @media print { .dome-controls { display: none; } }`);
  document.adoptedStyleSheets = [...document.adoptedStyleSheets, sheet];

  function made(name, attributes, parent) {
    const svg = ["svg", "g", "path", "circle", "text", "rect"].includes(name);
    const each = svg ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) each.setAttribute(key, value);
    if (parent) parent.append(each);
    return each;
  }

  // The larger, the farther from the page's color: lightness is even in steps, hue goes from yellow to red.
  function shade(share) {
    const chroma = 0.07 + 0.26 * share * (1 - share) + 0.04 * share;
    const light = `oklch(${0.95 - 0.6 * share} ${chroma} ${98 - 68 * share})`;
    return COLORS ? `light-dark(${light}, oklch(${0.33 + 0.6 * share} ${chroma} ${30 + 68 * share}))` : light;
  }

  function written(value) {
    if (value === null || !Number.isFinite(value)) return "unbounded";
    return value === 0 ? "0" : String(Number(value.toPrecision(value < 1 ? 2 : 3)));
  }

  // From shares of the scale to values and back; logarithmic where values differ by their ratio.
  function scale(values, share) {
    const known = values.filter((value) => value !== null && Number.isFinite(value));
    const low = share || !known.length ? 0 : Math.min(...known), high = share ? 100 : Math.max(...known, 0) || 1;
    const ratio = low > 0 && high > 1.001 * low;
    const from = ratio ? low : 0, log = Math.log(ratio ? high / low : 1);
    return {
      at: (value) => Math.min(1, Math.max(0, ratio ? Math.log(value / low) / log : (value - from) / (high - from))),
      value: (part) => (ratio ? low * Math.exp(part * log) : from + part * (high - from)),
    };
  }

  function dome(element, data, { onpick = () => {}, value = "rotation" } = {}) {
    let poses, points, order, picked = -1, reach, steepest, turn = -60, tilt = 24, width = 0, height = 0, places = [], held;
    element.classList.add("dome");
    const picture = made("svg", { class: "dome-picture", tabindex: 0, role: "application",
      "aria-roledescription": "picture to turn" }, element);
    const guides = made("g", { fill: "none", stroke: "currentColor", "stroke-opacity": 0.28 }, picture);
    const body = made("g", { "stroke-linejoin": "round" }, picture);
    const letters = made("g", { fill: "currentColor", "font-size": 12, "text-anchor": "middle", "aria-hidden": true }, picture);
    const legend = made("g", { fill: "currentColor", "font-size": 12, "text-anchor": "middle", "aria-hidden": true }, picture);
    const ray = made("path", { fill: "none", stroke: "currentColor", "stroke-width": 1.5, "stroke-dasharray": "5 3" });
    const ring = made("circle", { fill: "none", stroke: "currentColor", "stroke-width": 2.5 });
    const object = made("g", {});
    const controls = made("div", { class: "dome-controls" }, element);
    const choice = made("select", {}, label("Color"));
    const slider = made("input", { type: "range", min: 0, value: 0, step: 1 }, label("Poses, the worst last", "dome-wide"));
    const reading = made("output", { class: "dome-said" }, element);
    let marks = [];

    function label(words, kind = "") {
      const each = made("label", { class: kind }, controls);
      each.append(words);
      return each;
    }

    function update(given) {
      data = given;
      poses = data.poses;
      const count = poses.x.length;
      points = poses.x.map((x, i) => [x, poses.y[i], poses.z[i]]);
      const far = points.map((point) => Math.hypot(...point));
      reach = Math.max(...far, 1e-9);
      steepest = Math.max(10, ...points.map((point, i) => Math.acos(Math.max(-1, Math.min(1, point[2] / far[i]))) / RAD));
      const offered = Object.keys(SHOWN).filter((key) => poses[key]?.some((each) => each !== null));
      if (!offered.includes(value)) value = offered[0] ?? "rotation";
      choice.replaceChildren(...offered.map((key) => new Option(SHOWN[key][0], key, false, key === value)));
      slider.max = Math.max(0, count - 1);
      if (marks.length !== count) {
        marks = points.map(() => made("circle", { stroke: "currentColor", "stroke-width": 0.8 }));
        body.replaceChildren(...marks);
        picked = count;
      }
      color(value);
    }

    function numbers() {
      return (poses[value] ?? []).map((each) => (each !== null && SHARES.includes(value) ? 100 * each : each));
    }

    function color(key) {
      value = key;
      choice.value = key;
      const values = numbers(), [name, unit] = SHOWN[value], along = scale(values, SHARES.includes(value));
      order = points.map((_, i) => i).sort((a, b) => (values[a] ?? Infinity) - (values[b] ?? Infinity) || a - b);
      marks.forEach((mark, i) => {
        const known = values[i] !== null && Number.isFinite(values[i]);
        mark.setAttribute("fill", known ? shade(along.at(values[i])) : "none");
        mark.size = known ? 3.2 + 2.6 * along.at(values[i]) : 2.5;
      });
      const known = values.filter((each) => each !== null && Number.isFinite(each));
      const range = known.length ? `${written(Math.min(...known))} to ${written(Math.max(...known))}${unit}` : "unbounded";
      picture.setAttribute("aria-label", `${points.length} camera positions around the marker, colored by ${name}: `
        + `${range}. Arrow keys turn the picture; the slider below picks a pose.`);
      drawLegend(name + "," + unit, along);
      pick(picked < points.length ? picked : order.findLast((i) => Number.isFinite(values[i] ?? NaN)) ?? order.at(-1) ?? -1);
    }

    function drawLegend(title, along) {
      if (!width) return;
      const left = 0.1 * width, long = 0.8 * width, top = height - 34;
      legend.replaceChildren();
      for (let k = 0; k < STEPS; k++) {
        made("rect", { x: left + (long * k) / STEPS, y: top, width: long / STEPS + 0.6, height: 9,
          fill: shade((k + 0.5) / STEPS) }, legend);
      }
      made("rect", { x: left, y: top, width: long, height: 9, fill: "none", stroke: "currentColor", "stroke-width": 0.8 }, legend);
      made("text", { x: left, y: top - 6, "text-anchor": "start" }, legend).textContent = title;
      for (const part of width < 420 ? [0, 0.5, 1] : [0, 0.25, 0.5, 0.75, 1]) {
        made("text", { x: left + long * part, y: top + 23 }, legend).textContent = written(along.value(part));
      }
    }

    // Parallel projection: right, up, toward the viewer.
    function seen([x, y, z = 0]) {
      const s = Math.sin(turn * RAD), c = Math.cos(turn * RAD), away = c * x + s * y;
      const near = Math.cos(tilt * RAD), up = Math.sin(tilt * RAD);
      return [-s * x + c * y, near * z - up * away, up * z + near * away];
    }

    function draw() {
      if (!width || !points) return;
      const high = tilt <= steepest ? 1 : Math.cos((tilt - steepest) * RAD);
      const low = tilt + steepest >= 180 ? 1 : Math.max(0.05, -Math.cos((tilt + steepest) * RAD));
      const room = height - 78, factor = Math.min(width / 2.4, room / (high + low)) / reach;
      const middle = 18 + room / 2 + ((high - low) / 2) * factor * reach;
      const at = (point) => {
        const [right, up, toward] = seen(point);
        return [width / 2 + factor * right, middle - factor * up, toward];
      };
      const line = (path) => "M" + path.map((point) => at(point).slice(0, 2).map((each) => each.toFixed(1)).join(" ")).join("L");
      const on = (lean, around, far = reach) => [far * Math.sin(lean * RAD) * Math.cos(around * RAD),
        far * Math.sin(lean * RAD) * Math.sin(around * RAD), far * Math.cos(lean * RAD)];
      const steps = (count, to) => Array.from({ length: count + 1 }, (_, k) => (to * k) / count);
      const parallels = [30, 60, 90, 120, 150].filter((lean) => lean < steepest - 4).concat(steepest < 178 ? steepest : []);
      guides.replaceChildren(
        ...parallels.map((lean) => made("path", { d: line(steps(72, 360).map((around) => on(lean, around))) })),
        ...steps(11, 330).map((around) => made("path", { d: line(steps(24, steepest).map((lean) => on(lean, around))) })));
      drawObject(line);
      places = points.map(at);
      letters.replaceChildren();
      const edge = Math.min(steepest, 90), taken = [...places];
      const outward = (around) => steps(8, 0.4).map((more) => at(on(edge, around, (1.05 + more) * reach)));
      const beside = ([x, y]) => steps(60, width / 2).map((more) => [x + more, y]);
      for (const [words, spots] of [["x", outward(0)], ["y", outward(90)],
        ...parallels.filter((lean) => lean <= 90).map((lean) => [`${Math.round(lean)}°`, beside(at(on(lean, turn + 90)))])]) {
        // At the first place that is clear of dots and other letters.
        const half = 1 + 3.5 * words.length;
        const clear = ([x, y]) => x > half && x < width - half && y > 12
          && taken.every((other) => Math.abs(other[0] - x) > half + 5 || Math.abs(other[1] - y) > 11);
        const spot = spots.find(clear) ?? spots[0];
        taken.push(spot, [spot[0] - half, spot[1]], [spot[0] + half, spot[1]]);
        made("text", { x: spot[0], y: spot[1] + 4, "font-style": words.length < 2 ? "italic" : "normal" }, letters).textContent = words;
      }
      const depth = places.map((each, i) => [each[2], marks[i], i]).concat([[0, object, -1]]).sort((a, b) => a[0] - b[0]);
      for (const [toward, mark, i] of depth) {
        if (i >= 0) {
          mark.setAttribute("cx", places[i][0].toFixed(1));
          mark.setAttribute("cy", places[i][1].toFixed(1));
          if (steepest > 95) mark.setAttribute("opacity", toward < 0 ? 0.4 : 1);
          mark.setAttribute("r", (mark.size * (0.9 + (0.2 * toward) / reach)).toFixed(2));
        }
        body.append(mark);
      }
      if (picked >= 0) {
        ray.setAttribute("d", line([[0, 0, 0], points[picked]]));
        ring.setAttribute("cx", places[picked][0]);
        ring.setAttribute("cy", places[picked][1]);
        ring.setAttribute("r", marks[picked].size + 4);
        marks[picked].before(ray);
        body.append(ring);
      } else {
        ray.remove();
        ring.remove();
      }
    }

    // Plates, the farthest first, and on them the dots that face the viewer: no plate of a convex rig hides another's.
    function drawObject(line) {
      const faces = (data.room?.outlines ?? []).map((path) => {
        const middle = [0, 1, 2].map((k) => path.reduce((sum, point) => sum + (point[k] ?? 0), 0) / path.length);
        return [seen(middle)[2], made("path", { d: line(path) + "Z", fill: "#ffffff", stroke: "#777777" })];
      });
      const dots = (data.dots ?? []).flatMap(({ x, y, z = 0, diameter, normal = [0, 0, 1] }) => {
        if (seen(normal)[2] <= 0) return [];
        const first = Math.abs(normal[2]) > 0.9 ? [1, 0, 0] : [0, 0, 1];
        const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        const u = cross(normal, first), v = cross(normal, u), r = diameter / 2 / (Math.hypot(...u) || 1);
        const around = [0, 30, 60, 90, 120, 150, 180, 210, 240, 270, 300, 330].map((angle) => [x, y, z].map((each, k) =>
          each + r * (Math.cos(angle * RAD) * u[k] + Math.sin(angle * RAD) * v[k])));
        return [made("path", { d: line(around) + "Z", fill: "#1a1a1a" })];
      });
      object.replaceChildren(...faces.sort((a, b) => a[0] - b[0]).map(([, each]) => each), ...dots);
    }

    function words(i) {
      const [x, y, z] = points[i], far = Math.hypot(x, y, z);
      const lean = Math.acos(z / far) / RAD, around = lean < 0.5 ? "" : `, azimuth ${Math.round(Math.atan2(y, x) / RAD)}°`;
      const errors = ["rotation", "translation"].filter((key) => poses[key])
        .map((key) => (poses[key][i] === null ? `${SHOWN[key][0]} unbounded` : `${SHOWN[key][0]} ${written(poses[key][i])}${SHOWN[key][1]}`));
      const shares = SHARES.includes(value) && poses[value][i] !== null ? [`${SHOWN[value][0]} ${written(100 * poses[value][i])} %`] : [];
      const worst = !SHARES.includes(value) && i === order.at(-1) ? ", the worst" : "";
      return `Pose ${i + 1} of ${points.length}${worst}: ${written(far)} m, tilt ${Math.round(lean)}°${around}: `
        + [...errors, ...shares, ...(poses.words?.[i] ? [poses.words[i]] : [])].join(", ") + ".";
    }

    function pick(i) {
      picked = i >= 0 && i < points.length ? i : -1;
      const rank = order.indexOf(picked);
      slider.value = picked < 0 ? 0 : rank;
      const text = picked < 0 ? "" : words(picked);
      slider.setAttribute("aria-valuetext", text || "no pose");
      reading.textContent = text || "Drag or use the arrow keys to turn; click a camera to read its errors.";
      draw();
    }

    function choose(i) {
      pick(i);
      onpick(i);
    }

    // The nearest of those in front, where several are about as near.
    function under(event) {
      const box = picture.getBoundingClientRect();
      const x = ((event.clientX - box.left) * width) / box.width, y = ((event.clientY - box.top) * height) / box.height;
      let best = -1, least = NEAR;
      places.forEach((each, i) => {
        const away = Math.hypot(each[0] - x, each[1] - y) - (4 * each[2]) / reach;
        if (away < least) [best, least] = [i, away];
      });
      return best;
    }

    function turned(right, up) {
      turn = (turn - right) % 360;
      tilt = Math.max(steepest > 95 ? -90 : 0, Math.min(90, tilt + up));
      draw();
    }

    picture.addEventListener("pointerdown", (event) => {
      held = { x: event.clientX, y: event.clientY, moved: false };
      picture.setPointerCapture(event.pointerId);
    });
    picture.addEventListener("pointermove", (event) => {
      if (!held) {
        const i = under(event);
        picture.style.cursor = i >= 0 ? "pointer" : "grab";
        return;
      }
      const right = event.clientX - held.x, up = event.clientY - held.y;
      if (!held.moved && Math.hypot(right, up) < 4) return;
      held = { x: event.clientX, y: event.clientY, moved: true };
      turned(0.4 * right, 0.4 * up);
    });
    picture.addEventListener("pointerup", (event) => {
      const i = held && !held.moved ? under(event) : -1;
      held = undefined;
      if (i >= 0) choose(i);
    });
    picture.addEventListener("pointercancel", () => { held = undefined; });
    picture.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, 6], ArrowDown: [0, -6] }[event.key];
      if (!step) return;
      event.preventDefault();
      turned(...step);
    });
    slider.addEventListener("input", () => choose(order[Number(slider.value)]));
    choice.addEventListener("change", () => color(choice.value));

    new ResizeObserver(() => {
      const wide = Math.max(280, Math.round(element.clientWidth));
      if (wide === width || !element.clientWidth) return;
      [width, height] = [wide, Math.round(Math.min(0.5 * wide, 380) + 94)];
      picture.setAttribute("viewBox", `0 0 ${width} ${height}`);
      color(value);
    }).observe(element);
    update(data);
    return { update, pick, color, picked: () => picked };
  }
  return Object.assign(dome, { shade, scale });
})();
