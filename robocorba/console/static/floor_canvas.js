// Draws a floor on a canvas, +y up, with pan, zoom and picking: the plan, bodies, and the overlays of its owner.
// The plan is drawn to a canvas of its own, and again only when the view or the map has changed.
import { LabelPlacer, around } from "/static/label_placement.js";
import { shortened } from "/static/texts.js";

const MARGIN_PX = 24;
// Room at the right for the buttons of a page [px].
const TOOLS_PX = 36;
const MIN_PX_PER_M = 0.5;
const MAX_PX_PER_M = 2000;
const PICK_PX = 10;
// A shorter drag is a click.
const CLICK_PX = 5;
const LABEL_FONT = "12px system-ui, sans-serif";
const LABEL_PX = 14;
// Pictures of labels that are kept.
const MAX_SPRITES = 600;

// Colours that are told apart without red and green (after Okabe and Ito), for light and dark pages.
export const COLORS = {
  light: {
    ground: "#ffffff", outside: "#eef0f2", grid: "#e3e6ea", wall: "#2b3036", object: "#8d96a0", movable: "#b5651d",
    door: "#0072b2", locked: "#b00068", area: "#5a6570", node: "#00674b", edge: "#58a58c", robot: "#0072b2",
    lost: "#9aa1a9", carried: "#e69f00", laser: "#d55e00", text: "#14181c", shaft: "#c9cfd6", cabin: "#e6b800",
    selected: "#d55e00", path: "#6a3d9a", reserved: "#cc79a7", collision: "#b00068", proximity: "#0e7c86",
    unmapped: "#c4007a",
  },
  dark: {
    ground: "#1a1e22", outside: "#101316", grid: "#262b31", wall: "#d8dde3", object: "#78828d", movable: "#d99152",
    door: "#56b4e9", locked: "#ff7ac6", area: "#9aa5b1", node: "#4fd1a5", edge: "#2f7d66", robot: "#56b4e9",
    lost: "#6b737c", carried: "#e69f00", laser: "#ff9d5c", text: "#eef1f4", shaft: "#3a4149", cabin: "#5c4d12",
    selected: "#ff9d5c", path: "#b79ae0", reserved: "#cc79a7", collision: "#ff7ac6", proximity: "#5fd0da",
    unmapped: "#ff5cc0",
  },
};

export class FloorCanvas {
  // canvas: an element that its parent sizes. Events come as calls of `handlers`: pointer(kind, event, point, self),
  // where kind is down, move, up, cancel, leave or double. A handler for `down` that returns true takes the drag.
  constructor(canvas, handlers = {}) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.layer = document.createElement("canvas");
    this.layerContext = this.layer.getContext("2d");
    this.layerOf = [];
    this.labels = new LabelPlacer();
    this.sprites = new Map();
    this.handlers = handlers;
    this.plan = null;
    this.paths = null;
    this.floor = null;
    this.underlay = null;
    // Each may have below, above (metres) and labels (pixels), called with the context and the canvas.
    this.overlays = [];
    // Of a robot: {color, note, noteColor}, a colour other than its usual one, and words to its name. All may be missing.
    this.describe = () => ({});
    this.selected = "";
    this.isShownRoadmap = false;
    this.areNamesShown = true;
    this.scale = 40;
    this.centre = [0, 0];
    this.isFitted = true;
    this.isDrawn = false;
    this.drag = null;
    this.pointers = new Map();
    this.covered = [];
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(canvas.parentElement);
    this.listeners = {
      pointerdown: (event) => this.pointerDown(event),
      pointermove: (event) => this.pointerMove(event),
      pointerup: (event) => this.pointerUp(event, "up"),
      pointercancel: (event) => this.pointerUp(event, "cancel"),
      pointerleave: (event) => this.handlers.pointer?.("leave", event, this.point(event), this),
      dblclick: (event) => this.handlers.pointer?.("double", event, this.point(event), this),
      wheel: (event) => this.wheel(event),
      contextmenu: (event) => this.menu(event),
    };
    for (const [name, listener] of Object.entries(this.listeners)) {
      canvas.addEventListener(name, listener, { passive: false });
    }
    this.resize();
  }

  close() {
    this.observer.disconnect();
    for (const [name, listener] of Object.entries(this.listeners)) this.canvas.removeEventListener(name, listener);
    this.isClosed = true;
  }

  get colors() {
    return document.body.classList.contains("body--dark") ? COLORS.dark : COLORS.light;
  }

  setPlan(plan) {
    if (plan === this.plan) return;
    const isOther = plan?.name !== this.plan?.name;
    this.plan = plan;
    this.paths = plan ? planPaths(plan) : null;
    if (isOther) this.isFitted = true;
    if (this.isFitted) this.fit();
    this.redraw();
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

  // The body of the floor at a point, or undefined: the nearest within its radius and some pixels.
  bodyAt([x, y]) {
    let found, nearest = Infinity;
    for (const body of this.floor?.bodies.values() ?? []) {
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

  // ---- drawing ----

  redraw() {
    if (this.isDrawn || this.isClosed) return;
    this.isDrawn = true;
    requestAnimationFrame(() => {
      this.isDrawn = false;
      if (!this.isClosed && this.width) this.draw();
    });
  }

  draw() {
    const { context, colors } = this;
    const ratio = this.canvas.width / this.width;
    context.setTransform(1, 0, 0, 1, 0, 0);
    if (!this.plan) {
      context.fillStyle = colors.outside;
      context.fillRect(0, 0, this.canvas.width, this.canvas.height);
      return;
    }
    this.drawLayer(ratio);
    context.drawImage(this.layer, 0, 0);
    this.inWorld(context, ratio);
    if (this.floor) this.drawElevators();
    for (const overlay of this.overlays) overlay.below?.(context, this);
    if (this.floor) this.drawBodies();
    for (const overlay of this.overlays) overlay.above?.(context, this);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.labels.begin(this.width, this.height, this.covered);
    if (this.areNamesShown) this.drawNames();
    for (const overlay of this.overlays) overlay.labels?.(context, this);
    if (this.areNamesShown) this.drawAreaNames();
    this.labels.end();
  }

  // The plan, if it is not there already.
  drawLayer(ratio) {
    const { layer, layerContext: context, colors, paths, scale, centre } = this;
    const of = [
      paths, colors, scale, ...centre, this.canvas.width, this.canvas.height, this.isShownRoadmap, this.underlay?.image,
      this.underlay?.x, this.underlay?.y, this.underlay?.resolution, Boolean(this.floor),
    ];
    if (of.every((value, index) => value === this.layerOf[index])) return;
    this.layerOf = of;
    // Where the picture is: pixels of a point (x, y) are width / 2 + (x - centre x) * scale, height / 2 - (y - centre y) * scale.
    Object.assign(this.canvas.dataset, { floor: this.plan.name, scale, centre: centre.join(" ") });
    if (layer.width !== this.canvas.width) layer.width = this.canvas.width;
    if (layer.height !== this.canvas.height) layer.height = this.canvas.height;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = colors.outside;
    context.fillRect(0, 0, this.width, this.height);
    this.inWorld(context, ratio);
    this.drawPlan(context);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.drawScaleBar(context);
  }

  inWorld(context, ratio) {
    const [px, py] = this.pixel(0, 0);
    const scale = this.scale * ratio;
    context.setTransform(scale, 0, 0, -scale, px * ratio, py * ratio);
  }

  px(pixels) {
    return pixels / this.scale;
  }

  drawPlan(context) {
    const { colors, paths } = this;
    context.lineJoin = "round";
    context.lineCap = "round";
    context.fillStyle = colors.ground;
    context.fill(paths.ground);
    this.drawUnderlay(context);
    this.drawGrid(context);
    context.globalAlpha = 0.08;
    context.fillStyle = colors.area;
    context.fill(paths.areas);
    context.globalAlpha = 0.6;
    context.strokeStyle = colors.area;
    context.setLineDash([this.px(5), this.px(4)]);
    context.lineWidth = this.px(1);
    context.stroke(paths.areas);
    context.setLineDash([]);
    context.globalAlpha = 1;
    context.fillStyle = colors.shaft;
    context.fill(paths.shafts);
    context.fillStyle = context.strokeStyle = colors.object;
    context.lineWidth = this.px(2);
    context.fill(paths.fixed, "evenodd");
    context.stroke(paths.fixed);
    if (!this.floor) {
      context.fillStyle = context.strokeStyle = colors.movable;
      context.fill(paths.movable);
      context.stroke(paths.movable);
    }
    if (this.isShownRoadmap) {
      context.strokeStyle = colors.edge;
      context.lineWidth = this.px(1.5);
      context.stroke(paths.edges);
      context.fillStyle = colors.node;
      for (const node of this.plan.nodes) disc(context, node.at[0], node.at[1], this.px(3.5));
    }
    context.strokeStyle = colors.wall;
    context.lineWidth = Math.max(this.px(2), 0.06);
    context.stroke(paths.walls);
    for (const door of this.plan.doors) {
      context.strokeStyle = door.locked ? colors.locked : colors.door;
      context.lineWidth = this.px(door.kind === "opening" ? 1 : 3);
      if (door.kind === "opening") context.setLineDash([this.px(4), this.px(4)]);
      line(context, door.a, door.b);
      context.setLineDash([]);
    }
  }

  drawUnderlay(context) {
    if (!this.underlay?.image) return;
    const { image, x, y, resolution } = this.underlay;
    context.save();
    context.globalAlpha = 0.45;
    context.translate(x, y + image.height * resolution);
    context.scale(resolution, -resolution);
    context.drawImage(image, 0, 0);
    context.restore();
  }

  drawGrid(context) {
    const { colors } = this;
    const step = gridStep(this.scale);
    const [x0, y1] = this.world(0, 0);
    const [x1, y0] = this.world(this.width, this.height);
    context.beginPath();
    for (let x = Math.ceil(x0 / step) * step; x <= x1; x += step) {
      context.moveTo(x, y0);
      context.lineTo(x, y1);
    }
    for (let y = Math.ceil(y0 / step) * step; y <= y1; y += step) {
      context.moveTo(x0, y);
      context.lineTo(x1, y);
    }
    context.strokeStyle = colors.grid;
    context.lineWidth = this.px(1);
    context.stroke();
  }

  drawElevators() {
    const { context, colors } = this;
    for (const elevator of this.plan.elevators) {
      const state = this.floor.elevators[elevator.name];
      const isHere = state?.cabin === this.plan.name;
      if (isHere) {
        context.fillStyle = colors.cabin;
        polygon(context, elevator.polygon);
        context.fill();
      }
      const opening = isHere ? state.opening : 0;
      context.strokeStyle = colors.door;
      context.lineWidth = this.px(3);
      for (const [a, b] of elevator.doors) {
        const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
        const share = 1 - opening;
        const towards = (end) => end.map((value, axis) => value + (middle[axis] - value) * share);
        line(context, a, towards(a));
        line(context, b, towards(b));
      }
    }
  }

  drawBodies() {
    const { context, colors } = this;
    for (const body of this.floor.bodies.values()) {
      const isSelected = body.name === this.selected;
      if (body.kind === "object") {
        context.save();
        context.translate(body.x, body.y);
        context.rotate(body.heading);
        polygon(context, body.outline);
        context.fillStyle = colors.movable;
        context.fill();
        context.restore();
      } else {
        context.fillStyle = this.describe(body).color ?? colors.robot;
        disc(context, body.x, body.y, body.radius);
        const radius = body.radius;
        context.strokeStyle = "#ffffff";
        context.lineWidth = Math.max(radius * 0.14, this.px(1.5));
        const cos = Math.cos(body.heading), sin = Math.sin(body.heading);
        line(context, [body.x, body.y], [body.x + radius * 0.9 * cos, body.y + radius * 0.9 * sin]);
        const speed = Math.hypot(body.vx, body.vy);
        if (speed > 0.02) this.drawArrow(body, speed);
      }
      if (isSelected) {
        context.strokeStyle = colors.selected;
        context.lineWidth = this.px(3);
        context.beginPath();
        context.arc(body.x, body.y, body.radius + this.px(5), 0, 2 * Math.PI);
        context.stroke();
      }
    }
  }

  drawArrow(body, speed) {
    const { context, colors } = this;
    const ux = body.vx / speed, uy = body.vy / speed;
    const from = [body.x + ux * body.radius, body.y + uy * body.radius];
    const to = [from[0] + body.vx, from[1] + body.vy];
    const head = Math.min(this.px(8), speed * 0.5);
    context.strokeStyle = colors.text;
    context.lineWidth = this.px(1.5);
    line(context, from, to);
    line(context, to, [to[0] - head * (ux + uy * 0.5), to[1] - head * (uy - ux * 0.5)]);
    line(context, to, [to[0] - head * (ux - uy * 0.5), to[1] - head * (uy + ux * 0.5)]);
  }

  // Robots always have their names; objects and areas where there is room.
  drawNames() {
    const isVisible = (body) => this.isVisible(...this.pixel(body.x, body.y));
    const bodies = [...(this.floor?.bodies.values() ?? [])].filter(isVisible);
    const robots = bodies.filter((body) => body.kind !== "object");
    for (const body of robots) {
      const size = 2 * body.radius * this.scale;
      this.labels.block(...this.pixel(body.x, body.y), size, size);
    }
    robots.sort((a, b) => (b.name === this.selected) - (a.name === this.selected));
    for (const body of robots) {
      const { note, noteColor } = this.describe(body);
      const isBold = body.name === this.selected;
      this.drawLabel(body.number, shortened(body.name, 20), body, { note, noteColor, isBold, mustShow: true });
    }
    for (const body of bodies) if (body.kind === "object") this.drawLabel(body.number, shortened(body.name, 20), body);
  }

  // What is large has its name where the others have left room.
  drawAreaNames() {
    for (const elevator of this.plan.elevators) this.drawAreaName(this.elevatorText(elevator), elevator.at);
    for (const area of this.plan.areas) this.drawAreaName(shortened(area.name, 24), middleOf(area.polygon));
  }

  // An elevator's name, where its cabin is and how many wait; or that it does not stop on this floor.
  elevatorText({ name, floors }) {
    if (!floors.includes(this.plan.name)) return `${shortened(name, 16)}, no stop here`;
    const state = this.floor?.elevators[name];
    const text = shortened(name, 16);
    if (!state) return text;
    const where = state.cabin === this.plan.name ? "" : state.cabin ? ` at ${shortened(state.cabin, 8)}` : " moving";
    return `${text}${where}${state.queue.length ? `, ${state.queue.length} waiting` : ""}`;
  }

  // A name beside a disc {x, y, radius} of the floor.
  drawLabel(key, text, disc, { note = "", noteColor, color, isBold = false, mustShow = false, isWithin = false } = {}) {
    const { context, colors } = this;
    context.font = isBold ? `bold ${LABEL_FONT}` : LABEL_FONT;
    const lines = note ? [text, note] : [text];
    const width = Math.max(...lines.map((line) => this.labels.width(context, line))) + 4;
    const height = LABEL_PX * lines.length;
    const [px, py] = this.pixel(disc.x, disc.y);
    const offers = [...isWithin ? [[px, py]] : [], ...around(px, py, disc.radius * this.scale, width, height)];
    const place = this.labels.place(key, offers, width, height, mustShow);
    if (!place) return;
    lines.forEach((line, index) => {
      const y = place[1] - height / 2 + LABEL_PX * (index + 0.5);
      this.drawText(line, place[0], y, index ? noteColor ?? colors.collision : color ?? colors.text);
    });
  }

  drawAreaName(text, at) {
    const { context, colors } = this;
    context.font = LABEL_FONT;
    const [px, py] = this.pixel(...at);
    if (!this.isVisible(px, py)) return;
    const offers = [0, 1, -1, 2, -2].map((lines) => [px, py + lines * LABEL_PX]);
    const place = this.labels.place(`area ${text}`, offers, this.labels.width(context, text) + 4, LABEL_PX);
    if (place) this.drawText(text, ...place, colors.area);
  }

  // A line of text in the context's font, with a halo. Letters with a halo are slow to draw, so pictures of them are kept.
  drawText(text, px, py, color) {
    const { context, colors, sprites } = this;
    const ratio = this.canvas.width / this.width;
    const key = `${context.font}\n${color}\n${colors.ground}\n${ratio}\n${text}`;
    let sprite = sprites.get(key);
    if (!sprite) {
      if (sprites.size >= MAX_SPRITES) sprites.clear();
      sprite = textSprite(text, context.font, this.labels.width(context, text), color, colors.ground, ratio);
      sprites.set(key, sprite);
    }
    const [width, height] = [sprite.width / ratio, sprite.height / ratio];
    const sharp = (pixels) => Math.round(pixels * ratio) / ratio;
    context.drawImage(sprite, sharp(px - width / 2), sharp(py - height / 2), width, height);
  }

  isVisible(px, py) {
    return px > -50 && py > -20 && px < this.width + 50 && py < this.height + 20;
  }

  drawScaleBar(context) {
    const { colors } = this;
    const step = gridStep(this.scale);
    const length = step * this.scale;
    context.strokeStyle = context.fillStyle = colors.text;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(12, this.height - 12);
    context.lineTo(12 + length, this.height - 12);
    context.stroke();
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "left";
    context.textBaseline = "bottom";
    context.fillText(step < 1 ? `${Math.round(step * 100)} cm` : `${step} m`, 12, this.height - 15);
  }
}

function textSprite(text, font, width, color, halo, ratio) {
  const sprite = document.createElement("canvas");
  sprite.width = Math.ceil((width + 6) * ratio);
  sprite.height = Math.ceil((LABEL_PX + 8) * ratio);
  const context = sprite.getContext("2d");
  context.scale(ratio, ratio);
  Object.assign(context, { font, textAlign: "center", textBaseline: "middle", lineJoin: "round", lineWidth: 3 });
  context.strokeStyle = halo;
  context.fillStyle = color;
  context.strokeText(text, sprite.width / ratio / 2, sprite.height / ratio / 2);
  context.fillText(text, sprite.width / ratio / 2, sprite.height / ratio / 2);
  return sprite;
}

// ---- shapes ----

function planPaths(plan) {
  const paths = {
    ground: new Path2D(), areas: new Path2D(), shafts: new Path2D(), fixed: new Path2D(), movable: new Path2D(),
    edges: new Path2D(), walls: new Path2D(),
  };
  const [x0, y0, x1, y1] = plan.bounds;
  addPolygon(paths.ground, plan.outline.length ? plan.outline : [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]);
  for (const area of plan.areas) addPolygon(paths.areas, area.polygon);
  for (const elevator of plan.elevators) addPolygon(paths.shafts, elevator.polygon);
  for (const object of plan.objects) addPolygon(object.movable ? paths.movable : paths.fixed, object.polygon);
  for (const edge of plan.edges) addLine(paths.edges, edge.a, edge.b);
  const pieces = plan.walls.flatMap((wall) => wall.pieces);
  for (const piece of pieces) addLine(paths.walls, piece[0], piece[piece.length - 1]);
  if (plan.outline.length) addPolygon(paths.walls, plan.outline);
  for (const elevator of plan.elevators) addPolygon(paths.walls, elevator.polygon);
  return paths;
}

function addPolygon(path, points) {
  points.forEach(([x, y], index) => (index ? path.lineTo(x, y) : path.moveTo(x, y)));
  path.closePath();
}

function addLine(path, a, b) {
  path.moveTo(a[0], a[1]);
  path.lineTo(b[0], b[1]);
}

export function polygon(context, points) {
  context.beginPath();
  addPolygon(context, points);
}

export function line(context, a, b) {
  context.beginPath();
  addLine(context, a, b);
  context.stroke();
}

export function disc(context, x, y, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fill();
}

export function middleOf(points) {
  const xs = points.map((point) => point[0]), ys = points.map((point) => point[1]);
  return [(Math.min(...xs) + Math.max(...xs)) / 2, (Math.min(...ys) + Math.max(...ys)) / 2];
}

// Distance of grid lines [m]: 1, 2 or 5 times a power of ten, at least 40 pixels.
export function gridStep(scale) {
  const least = 40 / scale;
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= least);
}

// What is shown of a floor [m]: all of it; of an empty one the room for a building.
function shownBounds({ bounds: [x0, y0, x1, y1] }) {
  const isEmpty = x1 - x0 < 1.5 && y1 - y0 < 1.5; // the unit square
  return isEmpty ? [-2, -2, 18, 12] : [x0, y0, x1, y1];
}
