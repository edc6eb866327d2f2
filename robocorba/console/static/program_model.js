// A program while it is edited: a tree of icons with stable identities, to and from the JSON of program files.
//
// A node is {id, icon, values, bodies}: `values` holds the parameters (a condition or a destination is an object of its
// own), `bodies` the lists of icons by parameter.

// Steps that can be undone, and the length of their states together [characters].
const MAX_UNDO = 200;
const MAX_UNDO_LENGTH = 20_000_000;
// Limits of the file format; what is pasted or opened is refused above them.
const MAX_NESTING = 8;

let lastId = 0;

// The last identity that was given; `atLeast`: identities up to there are in use.
export function usedIds(atLeast = 0) {
  lastId = Math.max(lastId, atLeast);
  return lastId;
}

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

  // Parameters of an icon or condition, in order: {name, isRequired, isCondition, ...} and the members of its JSON
  // schema. Those that hold icons are not among them.
  parameters(definition) {
    return Object.entries(definition.properties)
      .filter(([name, property]) => name !== "icon" && name !== "when" && !this.isBody(property))
      .map(([name, property]) => ({
        ...this.resolved(property),
        name,
        isRequired: (definition.required ?? []).includes(name),
        isCondition: property.discriminator?.propertyName === "when",
      }));
  }

  // Names of the parameters of an icon that hold icons.
  bodies(icon) {
    const properties = this.icons.get(icon)?.properties ?? {};
    return Object.keys(properties).filter((name) => this.isBody(properties[name]));
  }

  isBody(property) {
    return property.items?.discriminator?.propertyName === "icon";
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

// An icon without parameters.
export function newNode(schema, icon) {
  const bodies = Object.fromEntries(schema.bodies(icon).map((name) => [name, []]));
  return { id: ++lastId, icon, values: {}, bodies };
}

// The node of an icon in JSON. Throws an Error with a message for the user.
export function nodeOf(schema, plain, path = "icons", depth = 1) {
  if (typeof plain !== "object" || plain === null || Array.isArray(plain)) throw new Error(`${path} is not an icon`);
  if (!schema.icons.has(plain.icon)) throw new Error(`${path}: there is no icon ${shortJson(plain.icon)}`);
  if (depth > MAX_NESTING) throw new Error(`${path}: more than ${MAX_NESTING} icons inside of each other`);
  const node = newNode(schema, plain.icon);
  for (const [name, value] of Object.entries(plain)) {
    if (name in node.bodies) node.bodies[name] = nodesOf(schema, value, `${path}.${name}`, depth + 1);
    else if (name !== "icon") node.values[name] = copied(value);
  }
  return node;
}

function nodesOf(schema, plain, path, depth = 1) {
  if (!Array.isArray(plain)) throw new Error(`${path} is not a list of icons`);
  return plain.map((each, index) => nodeOf(schema, each, `${path}[${index}]`, depth));
}

function shortJson(value) {
  return (JSON.stringify(value) ?? "without a name").slice(0, 60);
}

// A program in JSON text: {name, icons}, the icons as nodes. Throws an Error with a message for the user. Icons may be
// incomplete, since programs are saved while they are edited.
export function readProgram(schema, text) {
  let plain;
  try {
    plain = JSON.parse(text);
  } catch (error) {
    throw new Error(`it is not JSON: ${error.message}`);
  }
  if (typeof plain !== "object" || plain === null || !("icons" in plain)) throw new Error("it is not a program");
  if ((plain.format ?? 1) !== 1) throw new Error(`its format is ${shortJson(plain.format)}, not 1`);
  const unknown = Object.keys(plain).find((key) => !["format", "name", "robot", "icons"].includes(key));
  if (unknown) throw new Error(`it is not a program: ${unknown.slice(0, 60)} is unknown`);
  return { name: String(plain.name ?? "program").slice(0, 200), icons: nodesOf(schema, plain.icons, "icons") };
}

// The JSON of a node.
export function plainOf(node) {
  const bodies = Object.entries(node.bodies).filter(([name, body]) => body.length || name !== "otherwise");
  return {
    icon: node.icon,
    ...copied(node.values),
    ...Object.fromEntries(bodies.map(([name, body]) => [name, body.map(plainOf)])),
  };
}

// A number with four digits, towards zero: rounded, an angle of 180 degrees would be beyond its bound.
export function fourDigits(value) {
  return Math.trunc(value * 1e4 + Math.sign(value) * 1e-3) / 1e4;
}

// A copy of JSON values; members without a value are left out.
export function copied(value) {
  return value === undefined ? undefined : JSON.parse(JSON.stringify(value));
}

export class ProgramModel {
  constructor() {
    this.name = "program";
    this.icons = [];
    this.undone = [];
    this.done = [];
  }

  // Replace everything by a program as `readProgram` gives it.
  load({ name, icons }) {
    this.remember();
    this.name = name;
    this.icons = icons;
  }

  plain(icons = this.icons) {
    return { format: 1, name: this.name, robot: "SmartPal", icons: icons.map(plainOf) };
  }

  // ---- undo ----

  // Call before each change. `kind`: changes of the same kind in succession are undone together.
  remember(kind = "") {
    if (kind && kind === this.lastKind) return;
    this.lastKind = kind;
    this.done.push(this.state());
    this.undone = [];
    const length = () => this.done.reduce((sum, state) => sum + state.length, 0);
    while (this.done.length > MAX_UNDO || (this.done.length > 1 && length() > MAX_UNDO_LENGTH)) this.done.shift();
  }

  // The next change is undone by itself, whatever its kind.
  separate() {
    this.lastKind = "";
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

  // Where a node is: {list, index, parent, path, node}, or undefined.
  find(id) {
    for (const place of this.walk()) if (place.node.id === id) return place;
    return undefined;
  }

  *walk(list = this.icons, parent = null, at = "icons") {
    for (let index = 0; index < list.length; index++) {
      const path = `${at}[${index}]`;
      yield { list, index, parent, path, node: list[index] };
      const node = list[index];
      for (const [name, body] of Object.entries(node.bodies)) yield* this.walk(body, node, `${path}.${name}`);
    }
  }

  // The node that a path of the checker names, such as icons[2].then[0].
  at(path) {
    for (const place of this.walk()) if (place.path === path) return place.node;
    return undefined;
  }

  // Name of the list where a place of `find` or `walk` is.
  listName(place) {
    if (!place.parent) return "icons";
    return Object.entries(place.parent.bodies).find(([, list]) => list === place.list)[0];
  }

  body(parentId, name) {
    return parentId === null ? this.icons : this.find(parentId).node.bodies[name];
  }

  // ---- changes ----

  insert(node, parentId, name, index) {
    this.remember();
    this.body(parentId, name).splice(index, 0, node);
  }

  // Insert a node after another one; without one at the end.
  insertAfter(id, node) {
    const place = this.find(id);
    this.remember();
    if (place) place.list.splice(place.index + 1, 0, node);
    else this.icons.push(node);
  }

  // Move a node to a list; returns false if the list is inside of the node.
  move(id, parentId, name, index) {
    if (parentId !== null && this.contains(id, parentId)) return false;
    const from = this.find(id);
    const to = this.body(parentId, name);
    if (!from || !to) return false;
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

  set(id, name, value, kind = `${id} ${name}`) {
    const { node } = this.find(id);
    this.remember(kind);
    if (value === undefined) delete node.values[name];
    else node.values[name] = value;
  }

  // Move a node one place up (-1) or down (1); at the end of a list to the next list of its parent, or out of it.
  // Returns false if it is at the very end.
  shift(id, by) {
    const place = this.find(id);
    const { list, index, parent } = place, name = this.listName(place), target = index + by;
    if (target >= 0 && target < list.length) {
      return this.move(id, parent?.id ?? null, name, by > 0 ? target + 1 : target);
    }
    if (!parent) return false;
    const names = Object.keys(parent.bodies);
    const next = names[names.indexOf(name) + by];
    if (next) return this.move(id, parent.id, next, by > 0 ? 0 : parent.bodies[next].length);
    const outer = this.find(parent.id);
    return this.move(id, outer.parent?.id ?? null, this.listName(outer), outer.index + (by > 0 ? 1 : 0));
  }

  // Move a node into the icon before it, if that holds icons.
  enter(id) {
    const { list, index } = this.find(id);
    const before = list[index - 1];
    const name = Object.keys(before?.bodies ?? {}).pop();
    return name ? this.move(id, before.id, name, before.bodies[name].length) : false;
  }

  // Move a node out of the icon that holds it, behind that.
  leave(id) {
    const { parent } = this.find(id);
    if (!parent) return false;
    const outer = this.find(parent.id);
    return this.move(id, outer.parent?.id ?? null, this.listName(outer), outer.index + 1);
  }
}
