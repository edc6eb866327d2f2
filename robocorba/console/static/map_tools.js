// The drawing tools of the map page. A tool collects points and turns them into edits; it stays on until Escape.
import { distance, rounded } from "/static/map_model.js";

// points: how many make an element: [least, most]; most Infinity: until Enter, a double click, or the first point
// again. help: what to do; next: what to do after the first point.
export const TOOLS = [
  { name: "select", title: "Select", icon: "near_me", key: "v",
    help: "click, Shift for several, drag a frame; drag to move; Ctrl parts joined walls" },
  { name: "pan", title: "Pan", icon: "pan_tool", key: "h",
    help: "drag the map; the right mouse button does so with every tool" },
  { name: "room", title: "Room", icon: "crop_square", key: "r", points: [2, 2], kind: "wall",
    help: "click two opposite corners: four walls and a named area", next: "click the opposite corner" },
  { name: "wall", title: "Wall", icon: "timeline", key: "w", points: [2, Infinity], kind: "wall",
    help: "click corner by corner; Enter or a double click ends, Backspace takes a corner back, Escape drops all" },
  { name: "door", title: "Door", icon: "door_front", key: "d", points: [2, 2], kind: "door",
    help: "click twice on a wall: where the door begins, then where it ends",
    next: "click again on the wall, where the door ends" },
  { name: "box", title: "Box", icon: "inventory_2", key: "b", points: [2, 2], kind: "object",
    help: "click two opposite corners", next: "click the opposite corner" },
  { name: "circle", title: "Circle", icon: "radio_button_unchecked", key: "c", points: [2, 2], kind: "object",
    help: "click the middle, then the rim", next: "click where the rim is" },
  { name: "polygon", title: "Polygon", icon: "pentagon", key: "p", points: [3, Infinity], kind: "object",
    help: "click three or more corners; Enter, a double click or the first corner ends" },
  { name: "area", title: "Area", icon: "layers", key: "a", points: [3, Infinity], kind: "area",
    help: "click three or more corners; Enter, a double click or the first corner ends" },
  { name: "node", title: "Node", icon: "place", key: "n", points: [1, 1], kind: "node",
    help: "each click places a node of the roads" },
  { name: "edge", title: "Road", icon: "share", key: "e", points: [2, Infinity], kind: "edge",
    help: "click node by node; a click beside makes a node; Enter or a double click ends" },
  { name: "elevator", title: "Elevator", icon: "elevator", key: "l", points: [1, 1], kind: "elevator",
    help: "each click places an elevator with a door on each floor" },
  { name: "outline", title: "Outline", icon: "polyline", key: "o", points: [3, Infinity], kind: "floor",
    help: "click three or more corners of the floor's border; Enter or a double click ends" },
  { name: "path", title: "Path", icon: "route", key: "t", points: [2, 2],
    help: "click the start, then the goal, also on another floor; all modes are planned", next: "click the goal" },
];

export const toolOf = (name) => TOOLS.find((tool) => tool.name === name);

// Whether a point ends the drawing because it is the first or the last one again.
export function closes(tool, points, point) {
  if (tool.points[1] !== Infinity || points.length < tool.points[0]) return false;
  const isAgain = (other) => distance(other, point) < 1e-6;
  return isAgain(points[points.length - 1]) || (["polygon", "area", "outline"].includes(tool.name)
    && isAgain(points[0]));
}

// The edits that make elements of the points that were drawn; empty if they are none. options: of the page's tool bar.
export function editsOf(tool, points, elements, options) {
  const { floor } = elements;
  elements.forgetNames();
  // An object is named after its shape.
  const create = (kind, members, name = elements.newName(kind, "", members.shape?.kind)) => {
    const on = kind === "elevator" || kind === "floor" ? "" : floor;
    return { do: "create", kind, floor: on, name, members: { name, ...members } };
  };
  const walls = (corners) => {
    const pairs = corners.slice(1).map((to, n) => ({ from: corners[n], to }));
    return pairs.filter(({ from, to }) => distance(from, to) > 1e-3).map((ends) => create("wall", ends));
  };
  const isFlat = points.length === 2 && (points[0][0] === points[1][0] || points[0][1] === points[1][1]);
  switch (tool.name) {
    case "wall":
      return walls(points);
    case "room": {
      if (isFlat) return [];
      const [[x0, y0], [x1, y1]] = points;
      const corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
      return [...walls([...corners, corners[0]]), create("area", { polygon: corners })];
    }
    case "door":
      return [create("door", { from: points[0], to: points[1], kind: options.doorKind })];
    case "box": {
      if (isFlat) return [];
      const [[x0, y0], [x1, y1]] = points;
      const size = [rounded(Math.abs(x1 - x0)), rounded(Math.abs(y1 - y0))];
      return [object(create, { kind: "box", size }, [rounded((x0 + x1) / 2), rounded((y0 + y1) / 2)], options)];
    }
    case "circle":
      return [object(create, { kind: "circle", radius: rounded(distance(points[0], points[1])) }, points[0], options)];
    case "polygon": {
      const corners = points.map(([x, y]) => [rounded(x - points[0][0]), rounded(y - points[0][1])]);
      return [object(create, { kind: "polygon", points: corners }, points[0], options)];
    }
    case "area":
      return [create("area", { polygon: points })];
    case "node":
      return [create("node", { at: points[0] })];
    case "edge":
      return roads(points, elements, create, options);
    case "elevator":
      return elevator(points[0], elements, create, options);
    case "outline": {
      const record = elements.get(`floor/${floor}`);
      if (!record) return [];
      return [{ ...record, do: "change", members: { ...record.members, outline: points } }];
    }
    default:
      return [];
  }
}

function object(create, shape, at, { isMovable }) {
  return create("object", { shape, at, movable: isMovable });
}

function roads(points, elements, create, { isOneWay }) {
  const edits = [];
  const known = new Map(elements.of("node").map((node) => [String(node.members.at.map(rounded)), node.name]));
  const names = points.map((point) => {
    const key = String(point.map(rounded));
    if (!known.has(key)) {
      const edit = create("node", { at: point });
      edits.push(edit);
      known.set(key, edit.name);
    }
    return known.get(key);
  });
  for (let n = 1; n < names.length; n++) {
    if (names[n] === names[n - 1]) continue;
    const name = elements.newName("edge", `${names[n - 1]}-${names[n]}`);
    edits.push(create("edge", { from: names[n - 1], to: names[n], one_way: isOneWay }, name));
  }
  return edits;
}

// An elevator with a door on every floor; its nodes are made by the server.
function elevator(at, elements, create, { side }) {
  const doors = elements.of("floor").map(({ name }) => ({ floor: name, side, width: 1.2, offset: 0 }));
  return [create("elevator", { at, size: [2, 2], doors, heading: 0 })];
}
