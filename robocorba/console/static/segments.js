// Points and the lines between two points, all [x, y].

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
