// What the monitor draws on a floor beside its bodies: scans, planned ways, reserved areas, lost robots, a body being
// moved.
import { cross, disc, fillPale, line, polygon, ring, trace } from "/static/canvas_shapes.js";
import { areaRanges, hasAreas, rayEnds } from "/static/sensor_views.js";
import { distanceTo, placed } from "/static/segments.js";
import { shortened, wrapped } from "/static/texts.js";
import { ageText } from "/static/robot_rows.js";

// How long the reason of a refusal stays at its place [ms].
const REFUSAL_MS = 6000;
// Robots that have left are drawn with this radius, since nobody says it any more [m].
const LOST_RADIUS_M = 0.25;

export class MonitorScene {
  constructor(canvas) {
    this.canvas = canvas;
    // Rows of robots by name, and what is shown of them.
    this.robots = new Map();
    this.collisions = null;
    this.scans = [];
    this.reservations = [];
    this.floorName = "";
    // Whether the floor is one of the past: then what is known of the present is not drawn.
    this.isPast = false;
    // Age of the news of the whole floor [s], 0 while they come.
    this.floorAge = 0;
    this.shown = { scans: true, ways: true };
    // The body that is dragged: {body, x, y, heading}; and the last refusal: {text, x, y, until}.
    this.moved = null;
    this.refusal = null;
    // The ways that selected robots would drive: of each the points with their floor, x and y.
    this.drive = [];
    canvas.overlays.push(this);
    canvas.describe = (body) => this.describe(body);
  }

  describe(body) {
    const { colors } = this.canvas;
    if (this.isPast) return {};
    if (this.floorAge) return { color: colors.lost, note: `no news ${ageText(this.floorAge)}` };
    if (this.collisions?.has(body.name)) return { color: colors.collision, note: "collision" };
    const robot = this.robots.get(body.name);
    if (!robot) return {};
    if (robot.isSilent) return { color: colors.lost, note: `no answer ${ageText(robot.age)}` };
    const { kind, text } = robot.display;
    const note = shortened(text, 30);
    if (kind === "exceptional") return { note };
    return kind === "waiting" && robot.condition !== "idle" ? { note, noteColor: colors.text } : {};
  }

  refuse(text, x, y) {
    this.refusal = { text, x, y, until: performance.now() + REFUSAL_MS };
    setTimeout(() => this.canvas.redraw(), REFUSAL_MS + 50);
    this.canvas.redraw();
  }

  below(context) {
    if (!this.isPast && this.shown.ways) {
      for (const reservation of this.reservations) this.drawReservation(context, reservation);
      for (const robot of this.robots.values()) this.drawWay(context, robot);
    }
    if (this.isPast || !this.shown.scans) return;
    const hasArea = hasAreas(this.scans, this.canvas.selected);
    for (const scan of this.scans) this.drawScan(context, scan, hasArea(scan));
  }

  above(context) {
    if (!this.isPast) for (const robot of this.lostRobots()) this.drawLost(context, robot);
    for (const body of this.canvas.floor?.bodies.values() ?? []) {
      if (!this.isPast && this.collisions?.has(body.name)) this.drawCollision(context, body);
      else if (!this.isPast && this.robots.get(body.name)?.condition === "stopped") this.drawStopped(context, body);
    }
    if (this.moved) this.drawMoved(context);
    for (const way of this.drive) {
      const here = way.filter(({ floor }) => floor === this.floorName);
      this.drawRun(context, here.map(({ x, y }) => [x, y]), 4, this.canvas.colors.selected);
    }
  }

  labels(context) {
    const { canvas } = this;
    if (!this.isPast && this.shown.ways) {
      for (const { robot, phase, areas } of this.reservations) {
        const here = areas.filter((area) => area.floor === this.floorName);
        if (here.length) this.labelReservation(robot, phase, here[here.length - 1].polygon);
      }
    }
    if (!this.isPast) {
      for (const robot of this.lostRobots()) {
        const age = robot.goneAge ?? robot.age;
        const note = age === null ? robot.condition : `${robot.condition} ${ageText(age)} ago`;
        const disc = { ...robot.at, radius: this.lostRadius };
        canvas.drawLabel(`lost ${robot.name}`, shortened(robot.name, 20), disc, { note, mustShow: true });
      }
    }
    if (this.refusal && this.refusal.until > performance.now()) this.drawRefusal(context);
  }

  get lostRadius() {
    return Math.max(LOST_RADIUS_M, this.canvas.px(8));
  }

  // Robots with a known place on the floor whose body is not there any more.
  lostRobots() {
    const here = new Set([...(this.canvas.floor?.bodies.values() ?? [])].map((body) => body.name));
    return [...this.robots.values()].filter((robot) => robot.at && robot.floor === this.floorName
      && !here.has(robot.name)
      && robot.isLost);
  }

  // The lost robot at a point of the floor, or undefined.
  lostAt([x, y]) {
    if (this.isPast) return undefined;
    const reach = Math.max(this.lostRadius, this.canvas.px(12));
    return this.lostRobots().find(({ at }) => Math.hypot(at.x - x, at.y - y) < reach);
  }

  // The area that a sensor sees, with an outline if it is an actual robot's own, and what its rays hit.
  drawScan(context, scan, hasArea) {
    const { canvas } = this, { angles, ranges, hits, rim, sensor, virtual } = scan, at = rayEnds(scan);
    const isLaser = sensor === "laser";
    const color = isLaser ? canvas.colors.laser : canvas.colors.proximity;
    const isRound = angles.step * ranges.length > 2 * Math.PI - 1.5 * angles.step;
    if (hasArea) {
      const last = ranges.length - 1;
      const ends = isRound ? [] : [at(0, rim), at(last, rim)];
      context.fillStyle = context.strokeStyle = color;
      context.globalAlpha = 0.14;
      polygon(context, [...ends.slice(0, 1), ...areaRanges(scan).map((range, k) => at(k, range)), ...ends.slice(1)]);
      context.fill();
      context.globalAlpha = 0.8;
      context.lineWidth = canvas.px(1.5);
      if (!virtual) context.stroke();
    }
    const half = Math.max(0.5, 0.004 / Math.abs(angles.step)); // of a step
    for (const [kind, kindColor, width] of [[1, color, isLaser ? 2 : 4], [2, canvas.colors.unmapped, 5]]) {
      context.strokeStyle = kindColor;
      context.globalAlpha = isLaser && kind === 1 ? 0.9 : 1;
      context.lineWidth = canvas.px(width);
      context.beginPath();
      ranges.forEach((range, k) => {
        if (hits[k] !== kind) return;
        context.moveTo(...at(k - half, range));
        context.lineTo(...at(k + half, range));
      });
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  drawWay(context, robot) {
    const runs = (robot.path ?? []).filter((run) => run.floor === this.floorName && run.points.length > 1);
    if (!runs.length || robot.isSilent) return;
    const { canvas } = this;
    const body = canvas.floor?.body(robot.name);
    for (const run of runs) {
      const points = body ? ahead(run.points, body) : run.points;
      this.drawRun(context, points, robot.name === canvas.selected ? 4 : 2, canvas.colors.path);
    }
  }

  // A dashed way on this floor, with a cross at its end.
  drawRun(context, points, width, color) {
    if (!points.length) return;
    const { canvas } = this;
    context.strokeStyle = color;
    context.lineWidth = canvas.px(width);
    context.setLineDash([canvas.px(8), canvas.px(5)]);
    trace(context, points);
    context.stroke();
    context.setLineDash([]);
    context.lineWidth = canvas.px(2);
    cross(context, points[points.length - 1], canvas.px(6), true);
  }

  drawReservation(context, { areas, phase }) {
    const { canvas } = this;
    context.fillStyle = context.strokeStyle = canvas.colors.reserved;
    context.lineWidth = canvas.px(2);
    if (phase !== "granted") context.setLineDash([canvas.px(4), canvas.px(4)]);
    for (const area of areas) {
      if (area.floor !== this.floorName || area.polygon.length < 3) continue;
      polygon(context, area.polygon);
      context.globalAlpha = phase === "granted" ? 0.22 : 0.08;
      context.fill();
      context.globalAlpha = 0.9;
      context.stroke();
    }
    context.globalAlpha = 1;
    context.setLineDash([]);
  }

  labelReservation(robot, phase, corners) {
    const { canvas } = this;
    const x = corners.reduce((sum, corner) => sum + corner[0], 0) / corners.length;
    const y = corners.reduce((sum, corner) => sum + corner[1], 0) / corners.length;
    const text = phase === "granted" ? `reserved for ${shortened(robot, 16)}`
      : `${shortened(robot, 16)} waits for this area`;
    canvas.drawLabel(`area ${robot}`, text, { x, y, radius: 0 });
  }

  drawLost(context, robot) {
    const { canvas } = this;
    context.strokeStyle = context.fillStyle = canvas.colors.lost;
    context.globalAlpha = 0.4;
    disc(context, robot.at.x, robot.at.y, this.lostRadius);
    context.globalAlpha = 1;
    context.lineWidth = canvas.px(1.5);
    context.setLineDash([canvas.px(3), canvas.px(3)]);
    ring(context, robot.at.x, robot.at.y, this.lostRadius);
    context.setLineDash([]);
  }

  drawCollision(context, body) {
    const { canvas } = this;
    const isBright = Math.floor(performance.now() / 250) % 2 === 0;
    context.strokeStyle = canvas.colors.collision;
    context.lineWidth = canvas.px(isBright ? 5 : 2);
    const out = body.radius + canvas.px(6);
    for (let k = 0; k < 8; k++) {
      const angle = (k * Math.PI) / 4;
      const from = [body.x + out * Math.cos(angle), body.y + out * Math.sin(angle)];
      const far = out + canvas.px(8);
      line(context, from, [body.x + far * Math.cos(angle), body.y + far * Math.sin(angle)]);
    }
    this.blink ??= setTimeout(() => {
      this.blink = undefined;
      canvas.redraw();
    }, 250);
  }

  drawStopped(context, body) {
    const { canvas } = this;
    const size = Math.max(body.radius, canvas.px(6)) + canvas.px(3);
    context.strokeStyle = canvas.colors.collision;
    context.lineWidth = canvas.px(2.5);
    context.strokeRect(body.x - size, body.y - size, 2 * size, 2 * size);
  }

  drawMoved(context) {
    const { canvas, moved: { body, x, y, heading } } = this;
    context.strokeStyle = context.fillStyle = canvas.colors.selected;
    context.lineWidth = canvas.px(2);
    context.setLineDash([canvas.px(5), canvas.px(4)]);
    line(context, [body.x, body.y], [x, y]);
    if (body.kind === "object") polygon(context, placed(body.outline, { at: [x, y], heading }));
    else {
      context.beginPath();
      context.arc(x, y, body.radius, heading, heading + 2 * Math.PI);
      context.lineTo(x, y);
    }
    fillPale(context);
    context.setLineDash([]);
  }

  // The reason of a refusal as lines at its place, within the canvas.
  drawRefusal(context) {
    const { canvas, refusal } = this;
    context.font = "bold 13px system-ui, sans-serif";
    const lines = wrapped(context, refusal.text, 300);
    const width = Math.max(...lines.map((text) => context.measureText(text).width)) + 16;
    const height = 18 * lines.length + 10;
    let [px, py] = canvas.pixel(refusal.x, refusal.y);
    px = Math.min(Math.max(px, width / 2 + 4), canvas.width - width / 2 - 4);
    py = Math.min(Math.max(py - height / 2 - 14, height / 2 + 4), canvas.height - height / 2 - 4);
    context.fillStyle = canvas.colors.ground;
    context.strokeStyle = canvas.colors.collision;
    context.lineWidth = 2;
    context.fillRect(px - width / 2, py - height / 2, width, height);
    context.strokeRect(px - width / 2, py - height / 2, width, height);
    context.fillStyle = canvas.colors.collision;
    context.textAlign = "center";
    context.textBaseline = "middle";
    for (const [index, text] of lines.entries()) context.fillText(text, px, py - height / 2 + 14 + 18 * index);
  }
}

// The part of a way that is left from a body's place, beginning there.
function ahead(points, { x, y }) {
  let nearest = { distance: Infinity, index: 0 };
  for (let index = 0; index < points.length - 1; index++) {
    const distance = distanceTo([x, y], points[index], points[index + 1]);
    if (distance <= nearest.distance) nearest = { distance, index };
  }
  return [[x, y], ...points.slice(nearest.index + 1)];
}
