// Snapping of points while one draws: ends and nodes first, then lines, directions from the last point, and the grid.
import { distance, rounded } from "/static/map_model.js";
import { nearestOn } from "/static/segments.js";

const REACH_PX = 10;
const DIRECTION_STEP = Math.PI / 4;

// What a point snaps to: {at, to} where `to` is "end", "node", "line", "direction", "grid" or "".
// elements: of map_model.js. options: scale [pixels per m], step of the grid [m], isOff, last (the point before, for
// directions), skip (ids of elements that move), own (further points to snap to).
export function snap(point, elements, { scale, step, isOff, last, skip, own = [] }) {
  if (isOff) return { at: point.map(rounded), to: "" };
  const reach = REACH_PX / scale;
  const records = elements.shown.filter((record) => !skip?.has(`${record.kind}/${record.name}`));
  const end = nearestEnd(point, elements, records, own, reach);
  if (end) return end;
  const line = nearestLine(point, elements, records, step, reach);
  if (line) return line;
  if (last) {
    const direction = onDirection(point, last, step, reach);
    if (direction) return direction;
  }
  return { at: point.map((value) => onGrid(value, step)), to: "grid" };
}

export const onGrid = (value, step) => rounded(Math.round(value / step) * step);

function nearestEnd(point, elements, records, own, reach) {
  let found = null, least = reach;
  const offer = (at, to) => {
    const gap = distance(at, point);
    if (gap < least) [found, least] = [{ at: at.map(rounded), to }, gap];
  };
  for (const at of own) offer(at, "end");
  for (const record of records) {
    if (record.kind === "node") offer(record.members.at, "node");
    else if (record.kind === "elevator") offer(record.members.at, "end");
    else if (record.kind !== "edge" && !isRound(record)) {
      for (const at of elements.outline(record).points) offer(at, "end");
    }
  }
  const floor = elements.get(`floor/${elements.floor}`);
  for (const at of floor?.members.outline ?? []) offer(at, "end");
  return found;
}

const isRound = (record) => record.kind === "object" && record.members.shape.kind === "circle";

function nearestLine(point, elements, records, step, reach) {
  let found = null, least = reach * 0.8;
  const offer = (a, b) => {
    const near = nearestOn(a, b, point);
    const gap = distance(near, point);
    if (gap >= least) return;
    const length = distance(a, b) || 1;
    const along = Math.min(onGrid(distance(a, near), step), length);
    const at = [a[0] + ((b[0] - a[0]) * along) / length, a[1] + ((b[1] - a[1]) * along) / length];
    [found, least] = [{ at: at.map(rounded), to: "line" }, gap];
  };
  for (const record of records) if (record.kind === "wall") offer(record.members.from, record.members.to);
  const outline = elements.get(`floor/${elements.floor}`)?.members.outline ?? [];
  for (const [n, at] of outline.entries()) offer(at, outline[(n + 1) % outline.length]);
  return found;
}

// On a line from the last point in a direction of 45 degrees, at a whole number of steps of the grid.
function onDirection(point, last, step, reach) {
  const length = distance(point, last);
  if (length < step / 2) return null;
  const angle = Math.round(Math.atan2(point[1] - last[1], point[0] - last[0]) / DIRECTION_STEP) * DIRECTION_STEP;
  const [dx, dy] = [Math.cos(angle), Math.sin(angle)];
  const along = (point[0] - last[0]) * dx + (point[1] - last[1]) * dy;
  const aside = Math.abs((point[0] - last[0]) * dy - (point[1] - last[1]) * dx);
  if (aside > reach) return null;
  const isStraight = Math.abs(dx) < 1e-6 || Math.abs(dy) < 1e-6;
  const whole = isStraight ? onGrid(along, step) : onGrid(along * Math.SQRT1_2, step) * Math.SQRT2;
  return { at: [rounded(last[0] + whole * dx), rounded(last[1] + whole * dy)], to: "direction" };
}
