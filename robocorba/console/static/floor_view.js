// What of a floor a canvas shows, +y up: pan, zoom, and the pointer. Subclasses draw it.
import { colorsNow } from "/static/floor_colors.js";

const MARGIN_PX = 24;
// Room at the right for the buttons of a page [px].
const TOOLS_PX = 36;
const MIN_PX_PER_M = 0.5;
const MAX_PX_PER_M = 2000;
const PICK_PX = 10;
// A shorter drag is a click.
const CLICK_PX = 5;

export class FloorView {
  // canvas: an element that its parent sizes. Events come as calls of `handlers`: pointer(kind, event, point, self),
  // where kind is down, move, up, cancel, leave, double or menu. A handler for `down` that returns true takes the drag.
  constructor(canvas, handlers = {}) {
    this.canvas = canvas;
    this.handlers = handlers;
    this.plan = null;
    this.floor = null;
    this.scale = 40;
    this.centre = [0, 0];
    this.isFitted = true;
    this.isDrawn = false;
    this.drag = null;
    this.pointers = new Map();
    this.covered = [];
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(canvas.parentElement);
    const pointer = (kind) => (event) => this.handlers.pointer?.(kind, event, this.point(event), this);
    this.listeners = {
      pointerdown: (event) => this.pointerDown(event),
      pointermove: (event) => this.pointerMove(event),
      pointerup: (event) => this.pointerUp(event, "up"),
      pointercancel: (event) => this.pointerUp(event, "cancel"),
      pointerleave: pointer("leave"),
      dblclick: pointer("double"),
      wheel: (event) => this.wheel(event),
      contextmenu: (event) => this.menu(event),
    };
    for (const [name, listener] of Object.entries(this.listeners)) {
      canvas.addEventListener(name, listener, { passive: false });
    }
    this.recolor = () => this.redraw();
    window.addEventListener("robocorba-colors", this.recolor);
  }

  close() {
    this.observer.disconnect();
    for (const [name, listener] of Object.entries(this.listeners)) this.canvas.removeEventListener(name, listener);
    window.removeEventListener("robocorba-colors", this.recolor);
    this.isClosed = true;
  }

  get colors() {
    return colorsNow();
  }

  redraw() {
    if (this.isDrawn || this.isClosed) return;
    this.isDrawn = true;
    requestAnimationFrame(() => {
      this.isDrawn = false;
      if (!this.isClosed && this.width) this.draw();
    });
  }

  // ---- view ----

  resize() {
    const box = this.canvas.parentElement.getBoundingClientRect();
    const ratio = window.devicePixelRatio || 1;
    if (!box.width || !box.height) return; // not shown yet
    this.width = box.width;
    this.height = box.height;
    this.canvas.width = Math.round(box.width * ratio);
    this.canvas.height = Math.round(box.height * ratio);
    this.canvas.style.width = `${box.width}px`;
    this.canvas.style.height = `${box.height}px`;
    // Where buttons cover the canvas, labels are not put [px].
    this.covered = [...this.canvas.parentElement.querySelectorAll(".console-tools")].map((tools) => {
      const { left, top, right, bottom } = tools.getBoundingClientRect();
      return [left - box.left - 4, top - box.top - 4, right - box.left + 4, bottom - box.top + 4];
    });
    if (this.isFitted) this.fit();
    this.redraw();
  }

  fit() {
    if (!this.plan || !this.width) return;
    const [x0, y0, x1, y1] = shownBounds(this.plan);
    const across = (this.width - 2 * MARGIN_PX - TOOLS_PX) / Math.max(x1 - x0, 0.1);
    const down = (this.height - 2 * MARGIN_PX) / Math.max(y1 - y0, 0.1);
    this.scale = Math.min(Math.max(Math.min(across, down), MIN_PX_PER_M), MAX_PX_PER_M);
    this.centre = [(x0 + x1) / 2 + TOOLS_PX / 2 / this.scale, (y0 + y1) / 2];
    this.isFitted = true;
    this.redraw();
  }

  // Factor > 1 enlarges; the point (pixels, default the middle) stays where it is.
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const before = this.world(px, py);
    this.scale = Math.min(Math.max(this.scale * factor, MIN_PX_PER_M), MAX_PX_PER_M);
    const after = this.world(px, py);
    this.centre = [this.centre[0] + before[0] - after[0], this.centre[1] + before[1] - after[1]];
    this.isFitted = false;
    this.redraw();
  }

  pan(dx, dy) {
    this.centre = [this.centre[0] - dx / this.scale, this.centre[1] + dy / this.scale];
    this.isFitted = false;
    this.redraw();
  }

  centreOn(x, y) {
    this.centre = [x, y];
    this.isFitted = false;
    this.redraw();
  }

  world(px, py) {
    return [
      this.centre[0] + (px - this.width / 2) / this.scale,
      this.centre[1] - (py - this.height / 2) / this.scale,
    ];
  }

  pixel(x, y) {
    return [
      this.width / 2 + (x - this.centre[0]) * this.scale,
      this.height / 2 - (y - this.centre[1]) * this.scale,
    ];
  }

  point(event) {
    const box = this.canvas.getBoundingClientRect();
    return this.world(event.clientX - box.left, event.clientY - box.top);
  }

  // The body of the floor at a point, or undefined: the nearest that is wanted within its radius and some pixels.
  bodyAt([x, y], isWanted = () => true) {
    let found, nearest = Infinity;
    for (const body of [...this.floor?.bodies.values() ?? []].filter(isWanted)) {
      const distance = Math.hypot(body.x - x, body.y - y) - body.radius;
      if (distance < PICK_PX / this.scale && distance < nearest) [found, nearest] = [body, distance];
    }
    return found;
  }

  // ---- pointers ----

  pointerDown(event) {
    this.canvas.focus({ preventScroll: true });
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.pressed = [event.clientX, event.clientY];
    // A second finger pans and zooms: what the first one has begun ends.
    if (this.drag === "owner") this.handlers.pointer?.("cancel", event, this.point(event), this);
    const isMiddle = event.button === 1 || event.button === 2;
    const isTaken = !isMiddle && this.pointers.size === 1
      && this.handlers.pointer?.("down", event, this.point(event), this) === true;
    this.drag = isTaken ? "owner" : "pan";
    if (isMiddle) event.preventDefault();
  }

  pointerMove(event) {
    const before = this.pointers.get(event.pointerId);
    if (before && this.drag === "pan") {
      const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      if (others.length) {
        const was = Math.hypot(before[0] - others[0][0], before[1] - others[0][1]);
        const is = Math.hypot(event.clientX - others[0][0], event.clientY - others[0][1]);
        const box = this.canvas.getBoundingClientRect();
        if (was > 0) this.zoom(is / was, others[0][0] - box.left, others[0][1] - box.top);
      } else {
        this.pan(event.clientX - before[0], event.clientY - before[1]);
      }
    }
    if (before) this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (!before || this.drag === "owner") this.handlers.pointer?.("move", event, this.point(event), this);
  }

  pointerUp(event, kind) {
    if (!this.pointers.delete(event.pointerId)) return;
    if (this.drag === "owner") this.handlers.pointer?.(kind, event, this.point(event), this);
    else if (event.button === 2 && this.isClick(event)) this.handlers.pointer?.("menu", event, this.point(event), this);
    if (!this.pointers.size) this.drag = null;
  }

  isClick({ clientX, clientY }) {
    return Math.hypot(clientX - this.pressed[0], clientY - this.pressed[1]) < CLICK_PX;
  }

  // A long touch is what a right click is to a mouse; that is told when the button goes up, since it also pans.
  menu(event) {
    event.preventDefault();
    if (event.pointerType === "touch") this.handlers.pointer?.("menu", event, this.point(event), this);
  }

  wheel(event) {
    event.preventDefault();
    const box = this.canvas.getBoundingClientRect();
    this.zoom(Math.exp(-event.deltaY * (event.ctrlKey ? 0.01 : 0.0015)), event.clientX - box.left,
      event.clientY - box.top);
  }

  px(pixels) {
    return pixels / this.scale;
  }

  isVisible(px, py) {
    return px > -50 && py > -20 && px < this.width + 50 && py < this.height + 20;
  }
}

// What is shown of a floor [m]: all of it; of an empty one the room for a building.
function shownBounds({ bounds: [x0, y0, x1, y1] }) {
  const isEmpty = x1 - x0 < 1.5 && y1 - y0 < 1.5; // the unit square
  return isEmpty ? [-2, -2, 18, 12] : [x0, y0, x1, y1];
}
