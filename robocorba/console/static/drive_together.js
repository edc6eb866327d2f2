// Robots that drive to one place together get places of their own beside each other, the nearest robot the middle.

// Between two robots, and between a robot and what stands there [m].
const MARGIN_M = 0.3;
// Rings of places around the middle, and those of them that a robot tries.
const RINGS = 3, TRIES = 12;

// Free places around one in a honeycomb, the nearest first, for robots of these radii [m]. taken: {x, y, radius}.
export function placesAround({ floor, x, y }, radii, taken) {
  const largest = Math.max(...radii), step = 2 * largest + MARGIN_M, found = [];
  for (let row = -RINGS; row <= RINGS; row++) {
    for (let column = -2 * RINGS; column <= 2 * RINGS; column++) {
      const dx = step * (column + (row % 2) / 2), dy = step * row * Math.sqrt(0.75);
      found.push({ floor, x: x + dx, y: y + dy, distance: Math.hypot(dx, dy) });
    }
  }
  return found.filter((place) => place.distance < (RINGS + 0.1) * step
    && taken.every((body) => Math.hypot(body.x - place.x, body.y - place.y) > largest + body.radius + MARGIN_M))
    .sort((one, other) => one.distance - other.distance);
}

// A drive of each robot: {robot, goals, legs, problem}. bodies: those on the floor of the place. plan(robot, goals)
// returns the legs, or throws an Error with the reason.
export async function drivesTogether(robots, place, bodies, plan) {
  const isOf = ({ name }) => robots.some((robot) => robot.name === name);
  const radii = bodies.filter(isOf).map(({ radius }) => radius);
  const free = placesAround(place, radii.length ? radii : [0.5], bodies.filter((body) => !isOf(body)));
  const farness = ({ at }) => (at.floor === place.floor ? Math.hypot(at.x - place.x, at.y - place.y) : Infinity);
  const drives = [];
  for (const robot of [...robots].sort((one, other) => farness(one) - farness(other) || 0)) {
    const drive = { robot, goals: [], legs: [], problem: "" };
    for (const goal of free.slice(0, TRIES)) {
      try {
        Object.assign(drive, { legs: await plan(robot, [goal]), goals: [goal], problem: "" });
        free.splice(free.indexOf(goal), 1);
        break;
      } catch (error) {
        drive.problem ||= error.message;
      }
    }
    if (!drive.goals.length) drive.problem ||= "no place is free there";
    drives.push(drive);
  }
  return drives;
}
