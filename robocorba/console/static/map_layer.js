// What the map page draws over a floor: selection with handles, what is being drawn or moved, findings, and paths.
import { cross, disc, line, ring, trace } from "/static/canvas_shapes.js";
import { shortened } from "/static/texts.js";

export const HANDLE_PX = 6;
// An object counts as moved, and is drawn again, when it is so far from where it was [m, and rad].
const MOVED_M = 0.05;
const SAME_M = 0.01;
// Dashes that tell the modes of paths apart without colours.
export const PATH_STYLES = {
  smoothed: { dash: [], width: 3 }, topological: { dash: [10, 5], width: 2.5 }, geometric: { dash: [2, 5], width: 2.5 },
};

export class MapLayer {
  constructor() {
    this.elements = null;
    this.selected = [];       // records
    this.handles = [];        // of the only selected one
    this.ghosts = [];         // records as they will be: {kind, members}
    this.draft = [];          // points of a half-drawn element
    this.cursor = null;       // {at, to}: where the next point would be
    this.frame = null;        // two corners of a rubber band
    this.tool = null;
    this.findings = [];
    this.finding = -1;
    this.paths = [];          // {mode, points, isChosen}
    this.ends = [];           // of a path that is being chosen: {floor, x, y}
    this.places = new Map();  // {x, y, heading} of the objects that the simulation has moved, by name
  }

  // Take where objects stand in the simulation; returns whether one is elsewhere than before.
  takePlaces(floor) {
    const moved = new Map();
    for (const { members } of this.elements?.of("object") ?? []) {
      const body = members.movable && floor.body(members.name);
      if (body?.kind === "object" && !isAt(body, { x: members.at[0], y: members.at[1], heading: members.heading }, MOVED_M)) {
        moved.set(members.name, { x: body.x, y: body.y, heading: body.heading });
      }
    }
    const { places } = this;
    const isSame = moved.size === places.size && [...moved].every(([name, now]) => isAt(places.get(name), now, SAME_M));
    if (!isSame) this.places = moved;
    return !isSame;
  }

  above(context, canvas) {
    const { elements } = this;
    if (elements?.floor !== canvas.plan.name) return; // it is being loaded
    this.drawPaths(context, canvas);
    this.drawPlaces(context, canvas);
    for (const node of elements.of("node")) if (node.members.elevator) this.drawCabinNode(context, canvas, node);
    for (const record of this.selected) this.drawOutline(context, canvas, record, 3);
    for (const record of this.ghosts) this.drawOutline(context, canvas, record, 2, [canvas.px(6), canvas.px(4)]);
    context.fillStyle = canvas.colors.ground;
    context.strokeStyle = canvas.colors.selected;
    context.lineWidth = canvas.px(2);
    for (const handle of this.handles) this.drawHandle(context, canvas, handle);
    this.drawDraft(context, canvas);
    if (this.frame) this.drawFrame(context, canvas);
  }

  // Where objects stand now that are elsewhere than on the map.
  drawPlaces(context, canvas) {
    context.strokeStyle = canvas.colors.selected;
    context.lineWidth = canvas.px(1.5);
    context.setLineDash([canvas.px(2), canvas.px(3)]);
    for (const [record, { x, y, heading }] of this.moved()) {
      const { points } = this.elements.outline({ ...record, members: { ...record.members, at: [x, y], heading } });
      trace(context, points, true);
      context.stroke();
    }
    context.setLineDash([]);
  }

  moved() {
    const known = [...this.places].map(([name, place]) => [this.elements.get(`object/${name}`), place]);
    return known.filter(([record]) => record);
  }

  drawOutline(context, canvas, record, width, dash = []) {
    const { points, isClosed } = this.elements.outline(record);
    if (!points.length) return;
    context.strokeStyle = context.fillStyle = canvas.colors.selected;
    context.lineWidth = canvas.px(width);
    context.setLineDash(dash);
    if (points.length === 1) {
      ring(context, ...points[0], canvas.px(7));
    } else {
      trace(context, points, isClosed);
      if (isClosed) {
        context.globalAlpha = 0.12;
        context.fill();
        context.globalAlpha = 1;
      }
      if (!dash.length) { // a halo, since movable objects are of a similar colour
        context.strokeStyle = canvas.colors.ground;
        context.lineWidth = canvas.px(width + 4);
        context.stroke();
        context.strokeStyle = canvas.colors.selected;
        context.lineWidth = canvas.px(width);
      }
      context.stroke();
    }
    context.setLineDash([]);
  }

  drawHandle(context, canvas, { at, isTurn }) {
    const size = canvas.px(HANDLE_PX);
    context.beginPath();
    if (isTurn) context.arc(at[0], at[1], size, 0, 2 * Math.PI);
    else context.rect(at[0] - size, at[1] - size, 2 * size, 2 * size);
    context.fill();
    context.stroke();
  }

  // A ring: such a node belongs to its elevator.
  drawCabinNode(context, canvas, { members }) {
    context.strokeStyle = canvas.colors.node;
    context.lineWidth = canvas.px(1.5);
    ring(context, ...members.at, canvas.px(7));
  }

  drawDraft(context, canvas) {
    const { draft, cursor, tool } = this;
    if (!tool?.points) return;
    const points = cursor ? [...draft, cursor.at] : draft;
    context.strokeStyle = context.fillStyle = canvas.colors.selected;
    context.lineWidth = canvas.px(2.5);
    if (points.length > 1) {
      context.setLineDash([canvas.px(7), canvas.px(4)]);
      if (tool.name === "room" || tool.name === "box") {
        const [[x0, y0], [x1, y1]] = points;
        context.strokeRect(Math.min(x0, x1), Math.min(y0, y1), Math.abs(x1 - x0), Math.abs(y1 - y0));
      } else if (tool.name === "circle") {
        ring(context, ...points[0], Math.hypot(points[1][0] - points[0][0], points[1][1] - points[0][1]));
      } else {
        trace(context, points, ["polygon", "area", "outline"].includes(tool.name));
        context.stroke();
      }
      context.setLineDash([]);
    }
    for (const point of draft) disc(context, point[0], point[1], canvas.px(4));
    if (cursor) this.drawCursor(context, canvas, cursor);
  }

  // The shape says what the point snaps to: square end, circle node, cross line, small cross grid or direction.
  drawCursor(context, canvas, { at: [x, y], to }) {
    const size = canvas.px(to === "grid" || to === "direction" || !to ? 5 : 7);
    context.lineWidth = canvas.px(2);
    if (to === "node") ring(context, x, y, size);
    else if (to === "end") context.strokeRect(x - size, y - size, 2 * size, 2 * size);
    else cross(context, [x, y], size, to === "line");
  }

  drawFrame(context, canvas) {
    const [[x0, y0], [x1, y1]] = this.frame;
    context.strokeStyle = context.fillStyle = canvas.colors.selected;
    context.lineWidth = canvas.px(1);
    context.globalAlpha = 0.1;
    context.fillRect(x0, y0, x1 - x0, y1 - y0);
    context.globalAlpha = 1;
    context.strokeRect(x0, y0, x1 - x0, y1 - y0);
  }

  drawPaths(context, canvas) {
    context.strokeStyle = context.fillStyle = canvas.colors.path;
    const floor = this.elements.floor;
    for (const path of [...this.paths].sort((a, b) => a.isChosen - b.isChosen)) {
      const style = PATH_STYLES[path.mode];
      context.globalAlpha = path.isChosen ? 1 : 0.45;
      context.lineWidth = canvas.px(style.width + (path.isChosen ? 1.5 : 0));
      context.setLineDash(style.dash.map((pixels) => canvas.px(pixels)));
      path.points.forEach((point, n) => {
        const before = path.points[n - 1];
        if (before && before.floor === floor && point.floor === floor) line(context, [before.x, before.y], [point.x,
          point.y]);
      });
    }
    context.setLineDash([]);
    context.globalAlpha = 1;
    for (const end of this.ends) if (end.floor === floor) disc(context, end.x, end.y, canvas.px(6));
  }

  labels(context, canvas) {
    if (this.elements?.floor !== canvas.plan.name) return;
    const { colors } = canvas;
    const write = (text, [px, py], color) => canvas.drawText(text, px, py - 7, color);
    context.font = "12px system-ui, sans-serif";
    for (const [{ members }, { x, y }] of this.moved()) {
      write(`${shortened(members.name, 20)} stands here now`, canvas.pixel(x, y), colors.selected);
    }
    if (canvas.scale > 25) {
      for (const object of this.elements.of("object")) {
        const [x, y] = object.members.at;
        canvas.drawLabel(`object ${object.name}`, shortened(object.name, 18), { x, y, radius: 0 }, { isWithin: true });
      }
      for (const node of this.elements.of("node")) {
        const [x, y] = node.members.at;
        const spot = { x, y, radius: canvas.px(5) };
        canvas.drawLabel(`node ${node.name}`, shortened(node.name, 16), spot, { color: colors.node });
      }
    }
    if (this.cursor && this.tool?.points) {
      const [px, py] = canvas.pixel(...this.cursor.at);
      write(this.cursor.at.map((metres) => metres.toFixed(2)).join(", "), [px, py - 12], colors.selected);
    }
    this.ends.forEach((end, n) => {
      if (end.floor !== this.elements.floor) return;
      const [px, py] = canvas.pixel(end.x, end.y);
      write(n ? "goal" : "start", [px, py - 9], colors.path);
    });
    this.drawFindings(context, canvas);
    this.drawLength(canvas, write);
  }

  // A triangle with an exclamation mark at each place.
  drawFindings(context, canvas) {
    this.findings.forEach((finding, n) => {
      if (finding.floor !== this.elements.floor || finding.x === undefined) return;
      const [px, py] = canvas.pixel(finding.x, finding.y);
      const size = n === this.finding ? 13 : 9;
      context.fillStyle = canvas.colors.locked;
      context.strokeStyle = canvas.colors.ground;
      context.lineWidth = 2;
      context.beginPath();
      context.moveTo(px, py - size);
      context.lineTo(px + size, py + size * 0.8);
      context.lineTo(px - size, py + size * 0.8);
      context.closePath();
      context.stroke();
      context.fill();
      context.fillStyle = canvas.colors.ground;
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.font = `bold ${size + 2}px system-ui, sans-serif`;
      context.fillText("!", px, py + 1);
    });
    context.font = "12px system-ui, sans-serif";
  }

  // The length of what is being drawn, beside the cursor.
  drawLength(canvas, write) {
    const last = this.draft[this.draft.length - 1];
    if (!last || !this.cursor || !this.tool?.points) return;
    const [dx, dy] = [this.cursor.at[0] - last[0], this.cursor.at[1] - last[1]];
    const [px, py] = canvas.pixel(...this.cursor.at);
    const isFrame = this.tool.name === "room" || this.tool.name === "box";
    const text = isFrame
      ? `${Math.abs(dx).toFixed(2)} \u00d7 ${Math.abs(dy).toFixed(2)} m`
      : `${Math.hypot(dx, dy).toFixed(2)} m, ${((Math.atan2(dy, dx) * 180) / Math.PI).toFixed(0)}\u00b0`;
    write(text, [px, py - 12], canvas.colors.text);
  }
}

function isAt(before, now, reach) {
  const turned = 2 * Math.abs(Math.sin((before?.heading - now.heading) / 2));
  return Math.hypot(before?.x - now.x, before?.y - now.y) < reach && turned < reach;
}
