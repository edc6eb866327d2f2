// Shapes on a canvas, in the units of its context; all points are [x, y].

export function addPolygon(path, points) {
  points.forEach(([x, y], index) => (index ? path.lineTo(x, y) : path.moveTo(x, y)));
  path.closePath();
}

export function addLine(path, a, b) {
  path.moveTo(a[0], a[1]);
  path.lineTo(b[0], b[1]);
}

export function polygon(context, points) {
  trace(context, points, true);
}

export function line(context, a, b) {
  context.beginPath();
  addLine(context, a, b);
  context.stroke();
}

export function trace(context, points, isClosed) {
  context.beginPath();
  points.forEach(([x, y], index) => (index ? context.lineTo(x, y) : context.moveTo(x, y)));
  if (isClosed) context.closePath();
}

// A cross as of a sum, or turned by 45 degrees.
export function cross(context, [x, y], size, isTurned = false) {
  const [a, b] = isTurned ? [size, size] : [size, 0];
  line(context, [x - a, y - b], [x + a, y + b]);
  line(context, [x - b, y + a], [x + b, y - a]);
}

export function ring(context, x, y, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.stroke();
}

export function disc(context, x, y, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fill();
}
