import { live } from "/static/live.js";

// The movable objects of all floors, under the names by which robots know them: an object whose name several floors
// have is FLOOR/NAME. A line has no mass.
export function movables(floors) {
  const isMovable = ({ movable, polygon }) => movable && polygon.length > 2;
  const found = floors.flatMap((floor) => {
    const objects = live.plan(floor)?.objects ?? [];
    return objects.filter(isMovable).map((object) => ({ ...object, floor }));
  });
  const count = new Map();
  for (const { name } of found) count.set(name, (count.get(name) ?? 0) + 1);
  return found.map((object) => ({ ...object, name: count.get(object.name) > 1 ? `${object.floor}/${object.name}`
    : object.name }));
}
