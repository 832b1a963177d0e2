/* Bodies in three dimensions: a rig or a pad, with the centers of the cameras around it. */

import { digits, make } from "./dom.js";
import * as three from "./vendor/three.js";

const STEPS = 32, ROUND = [1, 2, 5, 10];

/* Show a GLB (ArrayBuffer, in m) and the poses {x, y, z, rotation?} around it; returns {update(look), dispose()}. Drag turns it, arrow keys do as well. */
export function show(element, glb, look) {
  let renderer;
  try {
    renderer = new three.WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
  } catch {
    element.replaceChildren(make("p", {}, "This browser shows no three dimensions (WebGL); everything else works."));
    return { update() {}, dispose() {} };
  }
  const canvas = renderer.domElement, said = make("p", { class: "note" }), space = make("div", { class: "space" }, canvas);
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "application");
  canvas.setAttribute("aria-roledescription", "picture to turn");
  canvas.setAttribute("aria-label", "The body in three dimensions, x red, y green, z blue; arrow keys turn it, plus and minus zoom");
  element.replaceChildren(space, said);
  renderer.setPixelRatio(window.devicePixelRatio);

  const scene = new three.Scene(), eye = new three.PerspectiveCamera(40, 1, 1e-3, 100), orbit = new three.OrbitControls(eye, canvas);
  const sun = new three.DirectionalLight(0xffffff, 2);
  scene.add(new three.AmbientLight(0xffffff, 1.6), sun);
  eye.up.set(0, 0, 1);
  let letters = [], cameras = null;

  const draw = () => {
    sun.position.copy(eye.position);
    renderer.render(scene, eye);
    for (const { tip, letter } of letters) {
      const at = tip.clone().project(eye);
      // In percent, since on paper the picture has another size.
      letter.style.left = `${50 + 50 * at.x}%`;
      letter.style.top = `${50 - 50 * at.y}%`;
    }
  };
  const fit = () => {
    const { clientWidth: width, clientHeight: height } = space;
    if (!width) return;
    renderer.setSize(width, height);
    eye.aspect = width / height;
    eye.updateProjectionMatrix();
    draw();
  };
  const update = (given = look) => {
    look = given;
    if (cameras) scene.remove(cameras);
    scene.add((cameras = centers(look.poses, element)));
    draw();
  };

  new three.GLTFLoader().parse(glb, "", ({ scene: body }) => {
    // glTF is y up; the frame of a rig is z up.
    body.rotation.x = Math.PI / 2;
    scene.add(body);
    const box = new three.Box3().setFromObject(body), center = box.getCenter(new three.Vector3()), size = box.getSize(new three.Vector3()).length();
    const long = round(size), axes = new three.AxesHelper(long);
    axes.setColors("#e02020", "#0a9a0a", "#2a5cff");
    scene.add(axes);
    letters = ["x", "y", "z"].map((name, index) => ({
      tip: new three.Vector3().setComponent(index, 1.08 * long), letter: make("span", { class: `axis-${name}`, "aria-hidden": "true" }, name),
    }));
    space.append(...letters.map((each) => each.letter));
    orbit.target.copy(center);
    eye.position.copy(center).add(new three.Vector3(0.9, -1.3, 1).multiplyScalar(size));
    eye.near = size / 100;
    eye.far = 400 * size;
    orbit.update();
    said.textContent = `Axes of ${digits(1e3 * long)} mm, cameras of ${look.poses.x.length} poses around, colored by error as below. Scroll, pinch or press minus to see them all.`;
    fit();
    update();
    canvas.dataset.ready = "true";
  }, (error) => { said.textContent = `The body cannot be shown: ${error.message}`; });

  orbit.addEventListener("change", draw);
  canvas.addEventListener("keydown", (event) => {
    const turn = { ArrowLeft: [-0.12, 0], ArrowRight: [0.12, 0], ArrowUp: [0, -0.12], ArrowDown: [0, 0.12] }[event.key];
    const zoom = { "+": 0.9, "=": 0.9, "-": 1.1 }[event.key];
    if (!turn && !zoom) return;
    event.preventDefault();
    const away = eye.position.clone().sub(orbit.target);
    if (zoom) away.multiplyScalar(zoom);
    else {
      const flat = Math.hypot(away.x, away.y), azimuth = Math.atan2(away.y, away.x) + turn[0];
      const rise = Math.min(1.5, Math.max(-1.5, Math.atan2(away.z, flat) - turn[1])), far = away.length();
      away.set(far * Math.cos(rise) * Math.cos(azimuth), far * Math.cos(rise) * Math.sin(azimuth), far * Math.sin(rise));
    }
    eye.position.copy(orbit.target).add(away);
    orbit.update();
    draw();
  });
  // Colors are those of a light or a dark page, or of paper.
  const media = ["(prefers-color-scheme: dark)", "print"].map((query) => window.matchMedia(query));
  const again = () => update(), theme = new MutationObserver(again);
  for (const each of media) each.addEventListener("change", again);
  theme.observe(document.documentElement, { attributeFilter: ["data-theme"] });
  const seen = new ResizeObserver(fit);
  seen.observe(space);
  return {
    update,
    dispose() {
      for (const each of media) each.removeEventListener("change", again);
      theme.disconnect();
      seen.disconnect();
      orbit.dispose();
      renderer.dispose();
      renderer.forceContextLoss();
    },
  };
}

/* The largest of 1, 2, 5, 10, 20 ... mm up to a length. */
function round(length) {
  const power = 10 ** Math.floor(Math.log10(1e3 * length));
  return ROUND.findLast((each) => each * power <= 1e3 * length * 1.0001) * power / 1e3;
}

/* Camera centers in the colors of the dome; without an error they are grey. */
function centers(poses, element) {
  const at = new Float32Array(poses.x.length * 3), colors = new Float32Array(at.length);
  const errors = poses.rotation || [], along = dome.scale(errors, false), palette = Array.from({ length: STEPS }, (_, k) => resolved(dome.shade(k / (STEPS - 1)), element));
  poses.x.forEach((x, index) => {
    at.set([x, poses.y[index], poses.z[index]], 3 * index);
    const known = Number.isFinite(errors[index] ?? NaN);
    colors.set(known ? palette[Math.round(along.at(errors[index]) * (STEPS - 1))] : [0.3, 0.3, 0.3], 3 * index);
  });
  const shape = new three.BufferGeometry(), look = new three.PointsMaterial({ size: 8, sizeAttenuation: false, vertexColors: true });
  shape.setAttribute("position", new three.BufferAttribute(at, 3));
  shape.setAttribute("color", new three.BufferAttribute(colors, 3));
  look.onBeforeCompile = (shader) => {
    shader.fragmentShader = shader.fragmentShader.replace("#include <color_fragment>", "#include <color_fragment>\nif (length(gl_PointCoord - 0.5) > 0.5) discard;");
  };
  return new three.Points(shape, look);
}

/* Linear red, green and blue of a color of a style sheet. */
function resolved(color, element) {
  element.style.color = color;
  const brush = document.createElement("canvas").getContext("2d");
  brush.fillStyle = getComputedStyle(element).color;
  element.style.color = "";
  brush.fillRect(0, 0, 1, 1);
  const [red, green, blue] = brush.getImageData(0, 0, 1, 1).data;
  return new three.Color().setRGB(red / 255, green / 255, blue / 255, "srgb").toArray();
}
