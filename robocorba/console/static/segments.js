// Points, the lines between two points, and polygons; all points are [x, y].

// The point of the line from a to b that is nearest to a point.
export function nearestOn(a, b, point) {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
  const share = ((point[0] - a[0]) * dx + (point[1] - a[1]) * dy) / (dx * dx + dy * dy || 1);
  const t = Math.min(Math.max(share, 0), 1);
  return [a[0] + t * dx, a[1] + t * dy];
}

// The distance of a point from the line from a to b.
export function distanceTo(point, a, b) {
  const [x, y] = nearestOn(a, b, point);
  return Math.hypot(point[0] - x, point[1] - y);
}

// Points in the frame of a body at a pose, in the floor's frame.
export function placed(points, { at, heading }) {
  const cos = Math.cos(heading), sin = Math.sin(heading);
  return points.map(([x, y]) => [at[0] + x * cos - y * sin, at[1] + x * sin + y * cos]);
}

// The inverse of `placed`.
export function unplaced(points, { at, heading }) {
  const cos = Math.cos(heading), sin = Math.sin(heading);
  return points.map(([x, y]) => [x - at[0], y - at[1]]).map(([x, y]) => [x * cos + y * sin, y * cos - x * sin]);
}

export function isInside(points, [x, y]) {
  let inside = false;
  for (let n = 0, m = points.length - 1; n < points.length; m = n++) {
    const [ax, ay] = points[n], [bx, by] = points[m];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
  }
  return inside;
}

// The middle of the box around points.
export function middleOf(points) {
  const xs = points.map((point) => point[0]), ys = points.map((point) => point[1]);
  return [(Math.min(...xs) + Math.max(...xs)) / 2, (Math.min(...ys) + Math.max(...ys)) / 2];
}
