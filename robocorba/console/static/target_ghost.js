// The ghost of an object at its target on a map: its footprint with an arrow, by whose tip it is turned.
import { disc, fillPale, line, polygon } from "/static/canvas_shapes.js";
import { isInside, placed } from "/static/segments.js";

// The tip is so far from the footprint, and is taken within this distance [pixels].
const TIP_PX = 24, GRASP_PX = 14;
const STEP_RAD = Math.PI / 12;

// The tip of a ghost. outline: in the object's own frame; gap: from the footprint [m].
export function tipOf(outline, { x, y, heading }, gap) {
  const reach = Math.max(...outline.map(([ahead]) => ahead), 0) + gap;
  return placed([[reach, 0]], { at: [x, y], heading })[0];
}

// What a press at a point takes of a ghost: "tip", "body", or "". scale: pixels per metre.
export function partAt(point, outline, target, scale) {
  const tip = tipOf(outline, target, TIP_PX / scale);
  if (Math.hypot(point[0] - tip[0], point[1] - tip[1]) < GRASP_PX / scale) return "tip";
  return isInside(placed(outline, { at: [target.x, target.y], heading: target.heading }), point) ? "body" : "";
}

// The heading towards a point, in steps of 15 degrees.
export function headingTo({ x, y }, point) {
  return Math.round(Math.atan2(point[1] - y, point[0] - x) / STEP_RAD) * STEP_RAD;
}

export function drawGhost(context, canvas, outline, target, color) {
  const { x, y, heading } = target, tip = tipOf(outline, target, canvas.px(TIP_PX));
  context.strokeStyle = context.fillStyle = color;
  context.lineWidth = canvas.px(2);
  polygon(context, placed(outline, { at: [x, y], heading }));
  fillPale(context);
  line(context, [x, y], tip);
  disc(context, ...tip, canvas.px(6));
}
