// The elements of a floor as the map page edits them: {kind, floor, name, version, members}, their shapes and handles.
import { isInside, nearestOn, placed, unplaced } from "/static/segments.js";

// What a new name of each kind begins with.
const PREFIXES = { wall: "w", object: "object ", door: "d", area: "room ", node: "n", elevator: "E", floor: "L",
  edge: "e" };
const CIRCLE_POINTS = 32;

export const idOf = (record) => `${record.kind}/${record.name}`;
export const copyOf = (value) => JSON.parse(JSON.stringify(value));
export const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
export const rounded = (value) => Math.round(value * 1e4) / 1e4;

// The elements of one floor, with all floors and elevators, by id.
export class Elements {
  constructor(floor = "", answer = { version: 0, elements: [] }) {
    this.floor = floor;
    this.version = answer.version;
    this.building = answer.building ?? "";
    this.byId = new Map(answer.elements.map((record) => [idOf(record), record]));
    this.given = new Set();
  }

  get(id) {
    return this.byId.get(id);
  }

  of(kind) {
    return [...this.byId.values()].filter((record) => record.kind === kind);
  }

  // What is seen on the floor, without the floor itself and elevators that don't stop here.
  get shown() {
    return [...this.byId.values()].filter((record) => record.kind !== "floor" && this.isHere(record));
  }

  isHere(record) {
    return record.kind !== "elevator" || record.members.doors.some((door) => door.floor === this.floor);
  }

  node(name) {
    return this.byId.get(`node/${name}`);
  }

  // A name that no element of the kind has: `wanted`, or of a word and a number. Each call gives another one.
  newName(kind, wanted = "", word = "") {
    const prefix = word ? `${word} ` : PREFIXES[kind];
    for (let number = 1; ; number++) {
      const name = wanted ? (number === 1 ? wanted : `${wanted} ${number}`) : `${prefix}${number}`;
      const id = `${kind}/${name}`;
      if (this.byId.has(id) || this.given.has(id)) continue;
      this.given.add(id);
      return name;
    }
  }

  forgetNames() {
    this.given.clear();
  }

  // Points of the element in metres, and whether they enclose it.
  outline({ kind, members }) {
    if (kind === "wall" || kind === "door") return { points: [members.from, members.to], isClosed: false };
    if (kind === "area") return { points: members.polygon, isClosed: true };
    if (kind === "node") return { points: [members.at], isClosed: false };
    if (kind === "floor") return { points: members.outline, isClosed: true };
    if (kind === "edge") {
      const ends = [this.node(members.from), this.node(members.to)].filter(Boolean);
      return { points: ends.map((node) => node.members.at), isClosed: false };
    }
    const shape = kind === "elevator" ? { kind: "box", size: members.size } : members.shape;
    return { points: placed(shapePoints(shape), members), isClosed: shape.kind !== "segment" };
  }

  // The element nearest to a point within `reach` [m]; small things before those that they lie on.
  at(point, reach) {
    let found, best = Infinity;
    for (const record of this.shown) {
      const rank = RANKS[record.kind];
      const gap = this.gap(record, point);
      if (gap > (rank < 4 ? reach : 0)) continue;
      const size = rank < 4 ? 0 : areaOf(this.outline(record).points) * 1e-6;
      const score = rank * 1000 + gap + Math.min(size, 500);
      if (score < best) [found, best] = [record, score];
    }
    return found;
  }

  // Distance of a point from an element [m]; 0 inside.
  gap(record, point) {
    const { points, isClosed } = this.outline(record);
    if (points.length === 1) return distance(points[0], point);
    return isClosed && isInside(points, point) ? 0 : this.gapToBorder(record, point);
  }

  gapToBorder(record, point) {
    const { points, isClosed } = this.outline(record);
    let least = Infinity;
    for (let n = isClosed ? 0 : 1; n < points.length; n++) {
      const a = points[(n || points.length) - 1];
      least = Math.min(least, distance(point, nearestOn(a, points[n], point)));
    }
    return least;
  }

  // Elements that lie in a rectangle entirely.
  within([x0, y0], [x1, y1]) {
    const [left, right, low, high] = [Math.min(x0, x1), Math.max(x0, x1), Math.min(y0, y1), Math.max(y0, y1)];
    const isWithin = ([x, y]) => x >= left && x <= right && y >= low && y <= high;
    return this.shown.filter((record) => {
      const { points } = this.outline(record);
      return points.length > 0 && points.every(isWithin);
    });
  }

  // [left, low, right, high] of elements, or null.
  bounds(records) {
    const points = records.flatMap((record) => this.outline(record).points);
    if (!points.length) return null;
    const xs = points.map((point) => point[0]), ys = points.map((point) => point[1]);
    return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
  }
}

const RANKS = { node: 0, door: 1, wall: 2, edge: 3, object: 4, elevator: 5, area: 6 };

// The members of an element moved by [dx, dy]; null for one that only follows others.
export function moved({ kind, members }, [dx, dy]) {
  const shift = ([x, y]) => [rounded(x + dx), rounded(y + dy)];
  const result = copyOf(members);
  if (kind === "wall" || kind === "door") [result.from, result.to] = [shift(members.from), shift(members.to)];
  else if (kind === "area") result.polygon = members.polygon.map(shift);
  else if (kind === "object" || kind === "node" || kind === "elevator") result.at = shift(members.at);
  else return null;
  return result;
}

// Points of an element that are dragged: {at, members(point)} gives the members with the handle at a point.
export function handlesOf({ kind, members }) {
  const with_ = (change) => (point) => {
    const result = copyOf(members);
    change(result, point.map(rounded));
    return result;
  };
  if (kind === "wall" || kind === "door") {
    return ["from", "to"].map((end) => ({ at: members[end], members: with_((result,
      point) => (result[end] = point)) }));
  }
  if (kind === "area" || kind === "floor") {
    const key = kind === "area" ? "polygon" : "outline";
    return members[key].map((at, n) => ({ at, members: with_((result, point) => (result[key][n] = point)) }));
  }
  if (kind !== "object" && kind !== "elevator") return [];
  const corners = kind === "object" && members.shape.kind === "polygon"
    ? placed(members.shape.points, members).map((at, n) => ({
      at,
      members: with_((result, point) => (result.shape.points[n] = unplaced([point], members)[0].map(rounded))),
    }))
    : [];
  const shape = kind === "elevator" ? { kind: "box", size: members.size } : members.shape;
  if (shape.kind === "circle") return []; // it looks the same when turned
  const reach = Math.max(...shapePoints(shape).map(([x]) => x), 0) + 0.4;
  const turn = {
    at: placed([[reach, 0]], members)[0],
    isTurn: true,
    members: with_((result, point) => {
      const angle = Math.atan2(point[1] - members.at[1], point[0] - members.at[0]);
      result.heading = rounded((Math.round(angle / (Math.PI / 12)) * Math.PI) / 12);
    }),
  };
  return [...corners, turn];
}

export function shapePoints(shape) {
  if (shape.kind === "segment") return [[-shape.length / 2, 0], [shape.length / 2, 0]];
  if (shape.kind === "polygon") return shape.points;
  if (shape.kind === "circle") {
    return Array.from({ length: CIRCLE_POINTS }, (_, n) => {
      const angle = (2 * Math.PI * n) / CIRCLE_POINTS;
      return [shape.radius * Math.cos(angle), shape.radius * Math.sin(angle)];
    });
  }
  const [x, y] = [shape.size[0] / 2, shape.size[1] / 2];
  return [[-x, -y], [x, -y], [x, y], [-x, y]];
}

function areaOf(points) {
  let sum = 0;
  points.forEach(([x, y], n) => {
    const [nx, ny] = points[(n + 1) % points.length];
    sum += x * ny - nx * y;
  });
  return Math.abs(sum) / 2;
}
