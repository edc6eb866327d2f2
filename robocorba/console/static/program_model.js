// A program while it is edited: a tree of icons with stable identities, to and from the JSON of program files.
//
// A node is {id, icon, values, bodies}: `values` holds the parameters (a condition or a destination is an object of its
// own), `bodies` the lists of icons by parameter.

const BODIES = { repeat: ["icons"], stop_if_closer: ["icons"], branch: ["then", "otherwise"] };
const MAX_UNDO = 200;

let lastId = 0;

export class Schema {
  constructor(schema) {
    this.definitions = schema.$defs;
    this.icons = new Map();
    this.conditions = new Map();
    for (const definition of Object.values(this.definitions)) {
      const icon = definition.properties?.icon?.enum?.[0], when = definition.properties?.when?.enum?.[0];
      if (icon) this.icons.set(icon, definition);
      if (when) this.conditions.set(when, definition);
    }
  }

  // Parameters of an icon or condition, in order: {name, isRequired, ...} and the members of its JSON schema.
  parameters(definition) {
    return Object.entries(definition.properties)
      .filter(([name]) => !["icon", "when", "icons", "then", "otherwise"].includes(name))
      .map(([name, property]) => ({ name, isRequired: definition.required.includes(name), ...this.resolved(property) }));
  }

  resolved(property) {
    if (property.anyOf && !property.discriminator) {
      const kept = property.anyOf.find((choice) => choice.type !== "null");
      return { ...this.resolved(kept), isOptional: true };
    }
    if (property.$ref) return this.definitions[property.$ref.split("/").pop()];
    return property;
  }
}

export function newNode(icon) {
  const values = {};
  if (icon === "wait_until" || icon === "branch") values.condition = { when: "closer_than" };
  if (icon === "move_table") values.to = {};
  const bodies = Object.fromEntries((BODIES[icon] ?? []).map((name) => [name, []]));
  return { id: ++lastId, icon, values, bodies };
}

export function nodeOf(plain) {
  const node = newNode(plain.icon);
  node.values = {};
  for (const [name, value] of Object.entries(plain)) {
    if (name in node.bodies) node.bodies[name] = value.map(nodeOf);
    else if (name !== "icon") node.values[name] = structuredClone(value);
  }
  return node;
}

// The JSON of a node; parameters without a value are left out.
export function plainOf(node) {
  const plain = { icon: node.icon };
  for (const [name, value] of Object.entries(node.values)) {
    const kept = withoutEmpty(value);
    if (kept !== undefined) plain[name] = kept;
  }
  for (const [name, body] of Object.entries(node.bodies)) {
    if (body.length || name !== "otherwise") plain[name] = body.map(plainOf);
  }
  return plain;
}

function withoutEmpty(value) {
  if (value === "" || value === null || value === undefined) return undefined;
  if (Array.isArray(value) || typeof value !== "object") return value;
  return Object.fromEntries(
    Object.entries(value).map(([name, each]) => [name, withoutEmpty(each)]).filter(([, each]) => each !== undefined),
  );
}

export class ProgramModel {
  constructor() {
    this.name = "program";
    this.icons = [];
    this.undone = [];
    this.done = [];
  }

  load(plain) {
    this.remember();
    this.name = plain.name;
    this.icons = plain.icons.map(nodeOf);
  }

  plain() {
    return { name: this.name, icons: this.icons.map(plainOf) };
  }

  // ---- undo ----

  // Call before each change. `kind`: changes of the same kind in succession are undone together.
  remember(kind = "") {
    if (kind && kind === this.lastKind) return;
    this.lastKind = kind;
    this.done.push(this.state());
    this.undone = [];
    if (this.done.length > MAX_UNDO) this.done.shift();
  }

  undo() {
    this.step(this.done, this.undone);
  }

  redo() {
    this.step(this.undone, this.done);
  }

  step(from, to) {
    if (!from.length) return;
    to.push(this.state());
    const state = JSON.parse(from.pop());
    this.name = state.name;
    this.icons = state.icons;
    this.lastKind = "";
  }

  state() {
    return JSON.stringify({ name: this.name, icons: this.icons });
  }

  // ---- tree ----

  // Where a node is: {list, index, parent, path}, or undefined.
  find(id) {
    for (const place of this.walk()) if (place.list[place.index].id === id) return place;
    return undefined;
  }

  *walk(list = this.icons, parent = null, at = "icons") {
    for (let index = 0; index < list.length; index++) {
      const path = `${at}[${index}]`;
      yield { list, index, parent, path, node: list[index] };
      for (const [name, body] of Object.entries(list[index].bodies)) yield* this.walk(body, list[index], `${path}.${name}`);
    }
  }

  // The node that a path of the checker names, such as icons[2].then[0].
  at(path) {
    for (const place of this.walk()) if (place.path === path) return place.node;
    return undefined;
  }

  body(parentId, name) {
    return parentId === null ? this.icons : this.find(parentId).list[this.find(parentId).index].bodies[name];
  }

  insert(node, parentId, name, index) {
    this.remember();
    this.body(parentId, name).splice(index, 0, node);
  }

  // Move a node to a list; returns false if the list is inside of the node.
  move(id, parentId, name, index) {
    if (parentId !== null && this.contains(id, parentId)) return false;
    const from = this.find(id);
    const to = this.body(parentId, name);
    this.remember();
    const [node] = from.list.splice(from.index, 1);
    to.splice(from.list === to && from.index < index ? index - 1 : index, 0, node);
    return true;
  }

  contains(id, inner) {
    for (let place = this.find(inner); place; place = place.parent && this.find(place.parent.id)) {
      if (place.node.id === id) return true;
    }
    return false;
  }

  remove(id) {
    this.remember();
    const { list, index } = this.find(id);
    list.splice(index, 1);
  }

  copy(id) {
    const { list, index, node } = this.find(id);
    this.remember();
    const copied = nodeOf(plainOf(node));
    list.splice(index + 1, 0, copied);
    return copied;
  }

  // Move a node one place up or down, out of its body at the ends.
  shift(id, by) {
    const { list, index, parent } = this.find(id);
    const target = index + by;
    this.remember();
    const [node] = list.splice(index, 1);
    if (target >= 0 && target <= list.length) {
      list.splice(target, 0, node);
    } else if (parent) {
      const outer = this.find(parent.id);
      outer.list.splice(outer.index + (by > 0 ? 1 : 0), 0, node);
    } else {
      list.splice(index, 0, node);
    }
  }
}

// Parameters that a node lacks or whose value is out of range: [{parameter, reason}].
export function missing(schema, node) {
  const found = [];
  const definition = schema.icons.get(node.icon);
  collect(schema, definition, node.values, "", found);
  for (const [name, body] of Object.entries(node.bodies)) {
    if (!body.length && name !== "otherwise") found.push({ parameter: name, reason: "has no icons yet" });
  }
  return found;
}

function collect(schema, definition, values, prefix, found) {
  for (const parameter of schema.parameters(definition)) {
    const value = values?.[parameter.name], name = prefix + parameter.name;
    if (parameter.name === "condition") {
      collect(schema, schema.conditions.get(value?.when), value, "condition.", found);
    } else if (parameter.properties) {
      collect(schema, parameter, value, `${name}.`, found);
    } else if (value === undefined || value === null || value === "") {
      if (parameter.isRequired) found.push({ parameter: name, reason: "is missing" });
    } else if (Array.isArray(value) && parameter.prefixItems) {
      parameter.prefixItems.forEach((item, index) => {
        if (typeof value[index] !== "number") found.push({ parameter: `${name}[${index}]`, reason: "is missing" });
      });
    } else if (parameter.type === "number" || parameter.type === "integer") {
      const reason = outOfRange(parameter, value);
      if (reason) found.push({ parameter: name, reason });
    }
  }
}

function outOfRange(parameter, value) {
  const { minimum, maximum, exclusiveMinimum } = parameter;
  if (typeof value !== "number" || !Number.isFinite(value)) return "is not a number";
  if (minimum !== undefined && value < minimum) return `is less than ${Number(minimum.toFixed(4))}`;
  if (exclusiveMinimum !== undefined && value <= exclusiveMinimum) return `is not more than ${exclusiveMinimum}`;
  if (maximum !== undefined && value > maximum) return `is more than ${Number(maximum.toFixed(4))}`;
  return "";
}

// What an icon does, in a few words.
export function summary(node) {
  const v = node.values;
  const number = (value) => (typeof value === "number" ? Number(value.toFixed(3)) : "?");
  const degrees = (value) => (typeof value === "number" ? `${Math.round((value * 180) / Math.PI)}\u00b0` : "?");
  const point = (to) => `${to?.floor ?? "?"} ${number(to?.x)}, ${number(to?.y)}`;
  switch (node.icon) {
    case "mbase_path": return `to ${point(v)}`;
    case "mbase_to": return `to ${number(v.x)}, ${number(v.y)}`;
    case "mbase_by": return `${number(v.ahead ?? 0)} m ahead, ${number(v.left ?? 0)} m left, ${degrees(v.turn ?? 0)}`;
    case "mbase_velocity": return `${number(v.ahead)} m/s, ${number(v.left)} m/s, ${degrees(v.turn)}/s for ${number(v.seconds)} s`;
    case "mhand_posture": return `${v.hand ?? "?"}: ${v.posture ?? "?"}`;
    case "mhand_pose": return `${v.hand ?? "?"} to ${number(v.x)}, ${number(v.y)}, ${number(v.z)}`;
    case "mhand_offset": return `${v.hand ?? "?"} by ${number(v.dx ?? 0)}, ${number(v.dy ?? 0)}, ${number(v.dz ?? 0)}`;
    case "mhand_joints": return `${v.hand ?? "?"}: ${(v.joints ?? []).map(degrees).join(" ")}`;
    case "lumbar": return `${degrees(v.lower)}, ${degrees(v.upper)}`;
    case "gripper": return `${v.action ?? "?"} ${v.hand ?? "?"}${v.object ? `: ${v.object}` : ""}`;
    case "wait": return `${number(v.seconds)} s`;
    case "wait_until": return `${conditionText(v.condition)}, at most ${number(v.seconds)} s`;
    case "stop_if_closer": return `${v.sensor ?? "?"} closer than ${number(v.distance)} m`;
    case "repeat": return `${v.times ?? "?"} times`;
    case "branch": return `if ${conditionText(v.condition)}`;
    case "say": return `${v.type ?? "?"}`;
    case "move_table": return `${v.table ?? "?"} to ${point(v.to)}`;
    case "hand_over": return `${v.object ?? "?"} to ${v.taker ?? "?"}`;
    default: return "";
  }
}

function conditionText(condition) {
  if (!condition) return "?";
  const distance = condition.distance ?? "?";
  switch (condition.when) {
    case "closer_than": return `${condition.sensor ?? "?"} closer than ${distance} m`;
    case "farther_than": return `${condition.sensor ?? "?"} farther than ${distance} m`;
    case "holding": return `${condition.hand ?? "?"} holds something`;
    case "event": return `event ${condition.type ?? "*"} from ${condition.source ?? "*"}`;
    default: return `result is ${condition.result ?? "?"}`;
  }
}
