/* Bodies in three dimensions: a rig or a pad, with the centers of the cameras around it. */

import { digits, make } from "./dom.js";
import * as three from "./vendor/three.js";

/* Show a GLB (ArrayBuffer, in m) and the poses {x, y, z, rotation?} around it; returns {dispose}. Drag turns it, arrow keys do as well. */
export function show(element, glb, look) {
  let renderer;
  try {
    renderer = new three.WebGLRenderer({ antialias: true, alpha: true });
  } catch {
    element.replaceChildren(make("p", {}, "This browser shows no three dimensions (WebGL); everything else works."));
    return { dispose() {} };
  }
  const canvas = renderer.domElement, said = make("p", { class: "note" });
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "The body in three dimensions, x red, y green, z blue; arrow keys turn it, plus and minus zoom");
  element.replaceChildren(canvas, said);
  renderer.setPixelRatio(window.devicePixelRatio);

  const scene = new three.Scene(), eye = new three.PerspectiveCamera(40, 1, 1e-3, 100), orbit = new three.OrbitControls(eye, canvas);
  const sun = new three.DirectionalLight(0xffffff, 2);
  scene.add(new three.AmbientLight(0xffffff, 1.6), sun);
  eye.up.set(0, 0, 1);

  const draw = () => {
    sun.position.copy(eye.position);
    renderer.render(scene, eye);
  };
  const fit = () => {
    const { clientWidth: width, clientHeight: height } = element;
    renderer.setSize(width, Math.max(height - 30, 100));
    eye.aspect = width / Math.max(height - 30, 100);
    eye.updateProjectionMatrix();
    draw();
  };

  new three.GLTFLoader().parse(glb, "", ({ scene: body }) => {
    // glTF is y up; the frame of a rig is z up.
    body.rotation.x = Math.PI / 2;
    scene.add(body);
    const box = new three.Box3().setFromObject(body), center = box.getCenter(new three.Vector3()), size = box.getSize(new three.Vector3()).length();
    scene.add(new three.AxesHelper(0.6 * size));
    scene.add(cameras(look.poses));
    orbit.target.copy(center);
    eye.position.copy(center).add(new three.Vector3(0.9, -1.3, 1).multiplyScalar(size));
    eye.near = size / 100;
    eye.far = 400 * size;
    orbit.update();
    said.textContent = `${digits(1e3 * size)} mm from corner to corner; ${look.poses.x.length} poses of the camera. Scroll to see them all.`;
    canvas.dataset.ready = "true";
    fit();
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
  const seen = new ResizeObserver(fit);
  seen.observe(element);
  return {
    dispose() {
      seen.disconnect();
      orbit.dispose();
      renderer.dispose();
    },
  };
}

/* Camera centers; the larger the error, the redder. */
function cameras(poses) {
  const at = new Float32Array(poses.x.length * 3), colors = new Float32Array(at.length), shade = new three.Color();
  const errors = (poses.rotation || []).filter(Number.isFinite), least = Math.log(Math.min(...errors)), most = Math.log(Math.max(...errors));
  poses.x.forEach((x, index) => {
    at.set([x, poses.y[index], poses.z[index]], 3 * index);
    const share = errors.length && most > least ? (Math.log(poses.rotation[index] ?? Infinity) - least) / (most - least) : 0;
    shade.setHSL(0.14 * (1 - Math.min(1, Math.max(0, share))), 0.85, 0.45).toArray(colors, 3 * index);
  });
  const shape = new three.BufferGeometry();
  shape.setAttribute("position", new three.BufferAttribute(at, 3));
  shape.setAttribute("color", new three.BufferAttribute(colors, 3));
  return new three.Points(shape, new three.PointsMaterial({ size: 5, sizeAttenuation: false, vertexColors: true }));
}
