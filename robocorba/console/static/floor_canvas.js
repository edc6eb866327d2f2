// Draws a floor on a canvas: the plan, elevators, bodies, names, and the overlays of its owner.
// The plan is drawn to a canvas of its own, and again only when the view or the map has changed.
import { disc, line, polygon, ring } from "/static/canvas_shapes.js";
import { LabelledView } from "/static/floor_labels.js";
import { drawPlan, drawScaleBar, planPaths } from "/static/floor_plan.js";
import { placed } from "/static/segments.js";

export class FloorCanvas extends LabelledView {
  // See FloorView.
  constructor(canvas, handlers) {
    super(canvas, handlers);
    this.layer = document.createElement("canvas");
    this.layerContext = this.layer.getContext("2d");
    this.layerOf = [];
    this.paths = null;
    this.underlay = null;
    // Each may have below, above (metres) and labels (pixels), called with the context and the canvas.
    this.overlays = [];
    this.isShownRoadmap = false;
    this.areNamesShown = true;
    // Names of further selected bodies.
    this.also = [];
    this.resize();
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
    drawPlan(context, this);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    drawScaleBar(context, this);
  }

  inWorld(context, ratio) {
    const [px, py] = this.pixel(0, 0);
    const scale = this.scale * ratio;
    context.setTransform(scale, 0, 0, -scale, px * ratio, py * ratio);
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
      const isSelected = body.name === this.selected || this.also.includes(body.name);
      if (body.kind === "object") {
        polygon(context, placed(body.outline, { at: [body.x, body.y], heading: body.heading }));
        context.fillStyle = colors.movable;
        context.fill();
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
        ring(context, body.x, body.y, body.radius + this.px(5));
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
}
