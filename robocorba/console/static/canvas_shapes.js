// Shapes on a canvas, in the units of its context; all points are [x, y].

export function addPolygon(path, points) {
  addLines(path, points);
  path.closePath();
}

function addLines(path, points) {
  for (const [x, y] of points.slice(0, 1)) path.moveTo(x, y);
  for (const [x, y] of points.slice(1)) path.lineTo(x, y);
}

export const addLine = (path, a, b) => addLines(path, [a, b]);

export const polygon = (context, points) => trace(context, points, true);

// The context's present path: its line, and pale within.
export function fillPale(context, alpha = 0.3) {
  context.globalAlpha = alpha;
  context.fill();
  context.globalAlpha = 1;
  context.stroke();
}

export function line(context, a, b) {
  context.beginPath();
  addLine(context, a, b);
  context.stroke();
}

export function trace(context, points, isClosed) {
  context.beginPath();
  addLines(context, points);
  if (isClosed) context.closePath();
}

// A cross as of a sum, or turned by 45 degrees.
export function cross(context, [x, y], size, isTurned = false) {
  const [a, b] = isTurned ? [size, size] : [size, 0];
  line(context, [x - a, y - b], [x + a, y + b]);
  line(context, [x - b, y + a], [x + b, y - a]);
}

function circle(context, x, y, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  return context;
}

export const ring = (...circleOf) => circle(...circleOf).stroke();
export const disc = (...circleOf) => circle(...circleOf).fill();
