// What is done with selected elements: edits that move, turn, align, duplicate and remove them.
import { copyOf, distance, idOf, moved } from "/static/map_model.js";

export const ALIGNMENTS = [
  { name: "left", icon: "align_horizontal_left" }, { name: "centre", icon: "align_horizontal_center" },
  { name: "right", icon: "align_horizontal_right" }, { name: "top", icon: "align_vertical_top" },
  { name: "middle", icon: "align_vertical_center" }, { name: "bottom", icon: "align_vertical_bottom" },
];

export const changeOf = (record, members) => ({ ...record, do: "change", members });

export function moveEdits(records, delta) {
  const pairs = records.map((record) => [record, moved(record, delta)]);
  return pairs.filter(([, members]) => members).map(([record, members]) => changeOf(record, members));
}

// The edits that take the ends of other walls along when a wall's end is dragged from a point to another.
export function joinedEdits(record, from, to, elements) {
  if (record.kind !== "wall") return [];
  return elements.of("wall").filter((wall) => wall.name !== record.name).flatMap((wall) => {
    const ends = ["from", "to"].filter((end) => distance(wall.members[end], from) < 1e-3);
    return ends.slice(0, 1).map((end) => changeOf(wall, { ...copyOf(wall.members), [end]: to }));
  });
}

export function alignEdits(records, elements, how) {
  const movable = records.filter((record) => moved(record, [0, 0]));
  const all = elements.bounds(movable);
  if (!all || movable.length < 2) return [];
  return movable.flatMap((record) => {
    const own = elements.bounds([record]);
    const delta = {
      left: [all[0] - own[0], 0], right: [all[2] - own[2], 0], centre: [(all[0] + all[2] - own[0] - own[2]) / 2, 0],
      bottom: [0, all[1] - own[1]], top: [0, all[3] - own[3]], middle: [0, (all[1] + all[3] - own[1] - own[3]) / 2],
    }[how];
    return Math.hypot(...delta) > 1e-6 ? moveEdits([record], delta) : [];
  });
}

// Copies beside the selected elements; roads between copied nodes are copied with them.
export function duplicateEdits(records, elements, step) {
  elements.forgetNames();
  const bounds = elements.bounds(records);
  const isElevator = records.some((record) => record.kind === "elevator");
  const delta = isElevator ? [Math.ceil(bounds[2] - bounds[0] + 1), 0] : [2 * step, -2 * step];
  const names = new Map();
  const nodes = records.filter((record) => record.kind === "node");
  for (const node of nodes) names.set(node.name, elements.newName("node"));
  const copies = records.filter((record) => record.kind !== "edge" && record.kind !== "floor").map((record) => {
    const name = names.get(record.name) && record.kind === "node" ? names.get(record.name)
      : elements.newName(record.kind, "", record.members.shape?.kind);
    const members = { ...moved(record, delta), name };
    if (record.kind === "node") members.elevator = "";
    return { do: "create", kind: record.kind, floor: record.floor, name, members };
  });
  const edges = elements.of("edge").filter(({ members }) => names.has(members.from) && names.has(members.to));
  for (const edge of edges) {
    const [from, to] = [names.get(edge.members.from), names.get(edge.members.to)];
    const name = elements.newName("edge", `${from}-${to}`);
    copies.push({ do: "create", kind: "edge", floor: edge.floor, name, members: { ...copyOf(edge.members), name, from,
      to } });
  }
  return copies;
}

// The edits that remove elements, and the nodes that stay because their elevator stops at them.
export function removeEdits(records) {
  const elevators = new Set(records.filter(({ kind }) => kind === "elevator").map(({ name }) => name));
  const isKept = ({ kind, members }) => kind === "node" && members.elevator && !elevators.has(members.elevator);
  const kept = records.filter(isKept);
  const isOfElevator = ({ kind, members }) => kind === "node" && elevators.has(members.elevator);
  const removed = records.filter((record) => !isKept(record) && !isOfElevator(record));
  return { edits: removed.map((record) => ({ ...record, do: "remove" })), kept };
}

// The selected records as they are now; those that are gone are left out.
export const current = (ids, elements) => ids.map((id) => elements.get(id)).filter(Boolean);

export const toggled = (ids, record) => {
  const id = idOf(record);
  return ids.includes(id) ? ids.filter((each) => each !== id) : [...ids, id];
};
