// A three.js scene on a canvas: draws when something has changed, restores a lost graphics context by itself, and takes
// fewer pixels where drawing is slow.
import { OrbitControls, THREE } from "nicegui-scene";

// Longest wait for the browser to restore a lost context [ms]; then a new canvas is made.
const RESTORE_MS = 3000;
// Bounds of the pixels drawn for each pixel of the page. They change when a picture took longer or shorter [ms].
const MIN_RATIO = 0.6, MAX_RATIO = 1.5;
const SLOW_MS = 45, FAST_MS = 16;
// Pictures between two changes of it.
const PICTURES = 12;

export class SceneView {
  // box: the element to fill. notify(message): why nothing is seen, or "". key, pointer(kind, event), moved(): what the
  // user does. remade(): there is a new canvas.
  constructor(box, { notify, key, pointer, moved, remade }) {
    Object.assign(this, { box, notify, key, pointer, moved, remade });
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(42, 1, 0.05, 800);
    this.camera.up.set(0, 0, 1);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x74808c, 2.1));
    const sun = new THREE.DirectionalLight(0xffffff, 1.5);
    sun.position.set(-8, -14, 20);
    this.scene.add(sun);
    this.ratio = Math.min(window.devicePixelRatio, MAX_RATIO);
    this.isSoftware = isSoftware();
    this.pictures = 0;
    this.slowness = [];
    this.makeCanvas();
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(box);
    this.recolor = () => this.setBackground();
    window.addEventListener("robocorba-colors", this.recolor);
    this.setBackground();
  }

  // A canvas of its own, so that it can be replaced. Throws an Error without WebGL.
  makeCanvas() {
    const before = this.orbit?.target.clone();
    this.orbit?.dispose();
    this.renderer?.dispose();
    this.canvas?.remove();
    const canvas = document.createElement("canvas");
    canvas.tabIndex = 0;
    canvas.setAttribute("aria-label", "3D view; arrows turn it, plus and minus zoom, 0 shows everything");
    this.box.prepend(canvas);
    this.canvas = canvas;
    canvas.sceneView = this; // for tests, which count its pictures
    try {
      this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.isSoftware, powerPreference: "low-power" });
    } catch {
      throw new Error("this browser draws no WebGL; the monitor page shows the same floors in 2D");
    }
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.maxPolarAngle = 1.52;
    this.orbit.minDistance = 0.4;
    this.orbit.maxDistance = 300;
    if (before) this.orbit.target.copy(before);
    this.orbit.addEventListener("change", () => this.redraw());
    this.orbit.addEventListener("start", () => this.moved());
    this.orbit.update();
    canvas.addEventListener("webglcontextlost", (event) => this.lost(event));
    canvas.addEventListener("webglcontextrestored", () => this.restored());
    canvas.addEventListener("keydown", (event) => this.key(event));
    for (const kind of ["pointerdown", "pointerup"]) {
      canvas.addEventListener(kind, (event) => this.pointer(kind, event));
    }
    this.resize();
  }

  lost(event) {
    event.preventDefault();
    if (this.isClosed) return;
    this.isLost = true;
    this.notify("the graphics were reset; waiting for them");
    this.restoring = setTimeout(() => {
      try {
        this.makeCanvas();
        this.restored();
        this.remade();
      } catch (error) {
        this.notify(error.message);
        this.lost(event);
      }
    }, RESTORE_MS);
  }

  restored() {
    clearTimeout(this.restoring);
    this.isLost = false;
    this.notify("");
    this.redraw();
  }

  setBackground() {
    this.scene.background = new THREE.Color(document.body.classList.contains("body--dark") ? 0x1b2026 : 0xdfe6ec);
    this.redraw();
  }

  resize() {
    const { width, height } = this.box.getBoundingClientRect();
    if (!width || !height) return;
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.redraw();
  }

  redraw() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = undefined;
      if (!this.isLost && !this.isClosed) this.draw();
    });
  }

  draw() {
    const began = performance.now();
    this.renderer.render(this.scene, this.camera);
    this.pictures++;
    this.lastPixel ??= new Uint8Array(4);
    // Reading a pixel waits for the picture, so that its time is known; only some pictures are measured.
    if (this.pictures % 4 === 0) {
      const gl = this.renderer.getContext();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, this.lastPixel);
      this.adapt(performance.now() - began);
    }
  }

  // Change the number of pixels when pictures take too long, or there is time for more.
  adapt(took) {
    this.slowness.push(took);
    if (this.slowness.length < PICTURES / 4) return;
    const median = this.slowness.sort((one, other) => one - other)[this.slowness.length >> 1];
    this.slowness = [];
    const most = Math.min(window.devicePixelRatio, MAX_RATIO);
    let wanted = this.ratio;
    if (median > SLOW_MS) wanted = Math.max(MIN_RATIO, this.ratio * 0.8);
    else if (median < FAST_MS) wanted = Math.min(most, this.ratio * 1.1);
    if (Math.abs(wanted - this.ratio) < 0.01) return;
    this.ratio = wanted;
    this.resize();
  }

  // The camera so that a box [[x, y, z], [x, y, z]] fills the view, seen from `direction` (from the box to the camera).
  fit([low, high], direction = [-0.25, -0.85, 0.95]) {
    const corners = [];
    for (const x of [low[0], high[0]]) {
      for (const y of [low[1], high[1]]) corners.push([x, y, low[2]], [x, y, high[2]]);
    }
    const middle = new THREE.Vector3(...low).add(new THREE.Vector3(...high)).multiplyScalar(0.5);
    const away = new THREE.Vector3(...direction).normalize();
    // Bounds of the box on the screen, from -1 to 1, seen from a distance; null if a corner is behind the camera.
    const seenFrom = (distance) => {
      this.camera.position.copy(middle).addScaledVector(away, distance);
      this.camera.lookAt(middle);
      this.camera.updateMatrixWorld();
      const seen = corners.map((corner) => new THREE.Vector3(...corner).project(this.camera));
      if (seen.some((corner) => corner.z > 1)) return null;
      const [xs, ys] = [seen.map(({ x }) => x), seen.map(({ y }) => y)];
      return { left: Math.min(...xs), right: Math.max(...xs), bottom: Math.min(...ys), top: Math.max(...ys) };
    };
    const right = new THREE.Vector3(), up = new THREE.Vector3();
    let distance = 1;
    for (let round = 0; round < 4; round++) {
      let seen = null;
      for (distance = 1; distance < 280; distance *= 1.03) {
        seen = seenFrom(distance);
        if (seen && seen.right - seen.left < 1.86 && seen.top - seen.bottom < 1.86) break;
      }
      if (!seen) break;
      // Near edges look larger than far ones: move to the middle of what is seen.
      const half = distance * Math.tan((this.camera.fov * Math.PI) / 360);
      const [aside, above] = [(seen.left + seen.right) / 2, (seen.bottom + seen.top) / 2];
      right.setFromMatrixColumn(this.camera.matrixWorld, 0).multiplyScalar(aside * half * this.camera.aspect);
      up.setFromMatrixColumn(this.camera.matrixWorld, 1).multiplyScalar(above * half);
      middle.add(right).add(up);
    }
    seenFrom(distance);
    this.orbit.target.copy(middle);
    this.orbit.update();
    this.redraw();
  }

  // Turn [rad] about what is looked at, and change the distance to it.
  turn(yaw, pitch, zoom = 1) {
    const offset = this.camera.position.clone().sub(this.orbit.target);
    const sphere = new THREE.Spherical().setFromVector3(new THREE.Vector3(offset.x, offset.z, -offset.y));
    sphere.theta += yaw;
    sphere.phi = Math.min(1.52, Math.max(0.02, sphere.phi + pitch));
    sphere.radius *= zoom;
    const turned = new THREE.Vector3().setFromSpherical(sphere);
    this.camera.position.copy(this.orbit.target).add(new THREE.Vector3(turned.x, -turned.z, turned.y));
    this.orbit.update();
    this.redraw();
  }

  // The scale of a sprite without attenuation that makes it one pixel high.
  get spritePixel() {
    return (2 * Math.tan((this.camera.fov * Math.PI) / 360)) / Math.max(1, this.box.clientHeight);
  }

  // A ray from the camera through a point of the canvas [px].
  rayAt([x, y]) {
    const { width, height } = this.box.getBoundingClientRect();
    const ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2((2 * x) / width - 1, 1 - (2 * y) / height), this.camera);
    return ray;
  }

  // A point of the world on the canvas [px], or null behind the camera.
  onCanvas(point) {
    const seen = point.clone().project(this.camera);
    if (seen.z > 1) return null;
    const { width, height } = this.box.getBoundingClientRect();
    return [((seen.x + 1) / 2) * width, ((1 - seen.y) / 2) * height];
  }

  close() {
    this.isClosed = true;
    clearTimeout(this.restoring);
    cancelAnimationFrame(this.frame);
    this.observer.disconnect();
    window.removeEventListener("robocorba-colors", this.recolor);
    this.orbit.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss(); // browsers allow few contexts
  }
}

let software;

// Whether the processor draws instead of a graphics card: smoothing edges would cost it more than everything else.
function isSoftware() {
  if (software === undefined) {
    const gl = document.createElement("canvas").getContext("webgl");
    const info = gl?.getExtension("WEBGL_debug_renderer_info");
    const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
    software = /swiftshader|llvmpipe|software|basic render/i.test(name);
    gl?.getExtension("WEBGL_lose_context")?.loseContext();
  }
  return software;
}
