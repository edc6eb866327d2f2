// A floor's map as meshes for three.js: ground, walls cut at a height, objects, shafts, doors and cabins of elevators.
import { THREE } from "nicegui-scene";
import { merged } from "/static/robot_model.js";
import { closeSprite, sizeSprite, textSprite } from "/static/text_sprite.js";

// Thickness of walls, of those around shafts, which the map may also have as walls, and of the dark cut on top.
const WALL_M = 0.10, SHAFT_WALL_M = 0.125, CUT_M = 0.03;
// Distance between a cabin and its shaft.
const CABIN_GAP_M = 0.12;
// A hand holds an object whose top is at most so far below it [m].
const HELD_M = 0.2;
const COLORS = {
  ground: [0.83, 0.85, 0.87],
  wall: [0.83, 0.82, 0.79],
  cut: [0.33, 0.34, 0.36],
  object: [0.55, 0.58, 0.62],
  door: [0.10, 0.45, 0.70],
  locked: [0.69, 0.0, 0.41],
  shaft: [0.66, 0.68, 0.70], cabin: [0.90, 0.72, 0.0],
};

export class FloorMesh {
  // z: height at which the floor is drawn [m].
  constructor(plan, cutHeight, z) {
    this.plan = plan;
    this.group = new THREE.Group();
    this.group.position.z = z;
    this.material = new THREE.MeshBasicMaterial({ vertexColors: true });
    this.doorMaterial = new THREE.MeshLambertMaterial({ color: 0x1b74b3 });
    this.movableMaterial = new THREE.MeshLambertMaterial({ color: 0xb5651d });
    this.movables = new Map();
    this.build(cutHeight);
  }

  build(cutHeight) {
    const { plan } = this;
    const pieces = [];
    const [x0, y0, x1, y1] = plan.bounds;
    const outline = plan.outline.length ? plan.outline : [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
    pieces.push([prism(outline, 0.05).translate(0, 0, -0.05), COLORS.ground]);
    for (const wall of plan.walls) {
      for (const piece of wall.pieces) {
        pieces.push(...cutWall(piece[0], piece[piece.length - 1], Math.min(wall.height, cutHeight)));
      }
    }
    if (plan.outline.length) {
      plan.outline.forEach((point, index) => {
        const next = plan.outline[(index + 1) % plan.outline.length];
        pieces.push(...cutWall(point, next, Math.min(plan.height, cutHeight)));
      });
    }
    for (const object of plan.objects) {
      if (!object.movable) pieces.push([solid(object, Math.min(object.height, cutHeight)), COLORS.object]);
    }
    for (const door of plan.doors) {
      if (door.kind === "opening" && !door.locked) continue;
      const color = door.locked ? COLORS.locked : COLORS.door;
      const height = door.locked ? Math.min(2, cutHeight) : 0.02;
      pieces.push([slab(door.a, door.b, height, 0.06), color]);
    }
    for (const elevator of plan.elevators) pieces.push(...shaftWalls(elevator, Math.min(2.2, cutHeight)));
    this.mesh?.removeFromParent();
    this.mesh?.geometry.dispose();
    this.mesh = new THREE.Mesh(lit(merged(pieces)), this.material);
    this.mesh.matrixAutoUpdate = false;
    this.group.add(this.mesh);
    this.buildDoors(Math.min(2, cutHeight));
  }

  buildDoors(height) {
    this.doors?.removeFromParent();
    this.doors?.traverse((part) => part.geometry?.dispose());
    this.doors = new THREE.Group();
    this.leaves = [];
    this.cabins = [];
    for (const elevator of this.plan.elevators) {
      const cabin = new THREE.Mesh(lit(merged(cabinParts(elevator))), this.material);
      cabin.visible = false;
      this.doors.add(cabin);
      this.cabins.push({ elevator: elevator.name, cabin });
      for (const [a, b] of elevator.doors) {
        const width = Math.hypot(b[0] - a[0], b[1] - a[1]);
        const angle = Math.atan2(b[1] - a[1], b[0] - a[0]);
        const box = () => new THREE.BoxGeometry(width / 2, 0.05, height);
        const leaves = [0, 1].map(() => new THREE.Mesh(box(), this.doorMaterial));
        for (const leaf of leaves) {
          leaf.rotation.z = angle;
          this.doors.add(leaf);
        }
        this.leaves.push({ elevator: elevator.name, a, b, width, angle, leaves, height });
      }
    }
    this.group.add(this.doors);
    this.setElevators({});
  }

  // states: of elevators by name, as in the frames of live floors. spread: as for the heights of floors.
  setElevators(states, spread = 1) {
    for (const { elevator, cabin } of this.cabins) {
      const above = states[elevator] ? states[elevator].height - this.plan.elevation : Infinity;
      // Each height belongs to one floor, so that the stack shows a cabin once.
      cabin.visible = above > -0.5 && above <= Math.max(this.plan.height, 1) - 0.5;
      if (cabin.visible) cabin.position.z = spread * above + 0.005;
    }
    for (const { elevator, a, b, width, angle, leaves, height } of this.leaves) {
      const state = states[elevator];
      const opening = state?.cabin === this.plan.name ? state.opening : 0;
      [a, b].forEach((end, side) => {
        // A leaf slides into its side of the wall: what is left of it stays at that end of the doorway.
        const scale = Math.max(1 - opening, 0.04);
        const along = (side ? -1 : 1) * (width / 4) * scale;
        leaves[side].scale.x = scale;
        leaves[side].position.set(end[0] + along * Math.cos(angle), end[1] + along * Math.sin(angle), height / 2);
      });
    }
  }

  // bodies: movable objects of a live floor; their heights are those of the map. hands: {x, y, z} of robots [m]; an
  // object whose top is a little below a hand above it is held and hangs from it.
  setObjects(bodies, hands = []) {
    const present = new Set();
    for (const body of bodies) {
      present.add(body.number);
      let mesh = this.movables.get(body.number);
      if (!mesh) {
        const isBody = ({ name }) => name === body.name || body.name.endsWith(`/${name}`);
        const known = this.plan.objects.find(isBody);
        const points = body.outline.length ? body.outline : circle(body.radius);
        const height = known?.height ?? 0.75;
        mesh = new THREE.Mesh(prism(points, height), this.movableMaterial);
        mesh.userData = { height, reach: Math.max(...points.map(([x, y]) => Math.hypot(x, y))) + 0.05 };
        this.movables.set(body.number, mesh);
        this.group.add(mesh);
      }
      mesh.position.set(body.x, body.y, heldAt(body, mesh.userData, hands));
      mesh.rotation.z = body.heading;
    }
    for (const [number, mesh] of this.movables) {
      if (!present.has(number)) {
        mesh.removeFromParent();
        mesh.geometry.dispose();
        this.movables.delete(number);
      }
    }
  }

  // Show the floor's name at its corner, for the stack of floors. pixel: as for sizeSprite.
  showName(pixel) {
    if (!this.name) {
      this.name = textSprite(this.plan.name, "#3b4650");
      this.name.position.set(this.plan.bounds[0], this.plan.bounds[1], 0.4);
      this.group.add(this.name);
    }
    sizeSprite(this.name, pixel);
  }

  close() {
    if (this.name) closeSprite(this.name);
    this.group.traverse((object) => object.geometry?.dispose());
    for (const material of [this.material, this.doorMaterial, this.movableMaterial]) material.dispose();
    this.group.removeFromParent();
  }
}

// Put the light on what never moves into its colours: cheaper than to compute it for each pixel of each picture.
function lit(geometry) {
  const { color, normal } = geometry.attributes;
  for (let vertex = 0; vertex < color.count; vertex++) {
    const [x, y, z] = [normal.getX(vertex), normal.getY(vertex), normal.getZ(vertex)];
    const light = 0.62 + 0.16 * z + 0.2 * Math.max(0, -0.31 * x - 0.55 * y + 0.78 * z) + 0.05 * Math.abs(x);
    color.setXYZ(vertex, color.getX(vertex) * light, color.getY(vertex) * light, color.getZ(vertex) * light);
  }
  return geometry;
}

function prism(points, height) {
  const shape = new THREE.Shape(points.map(([x, y]) => new THREE.Vector2(x, y)));
  return new THREE.ExtrudeGeometry(shape, { depth: height, bevelEnabled: false, steps: 1 });
}

function slab(a, b, height, thickness = WALL_M) {
  const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
  return new THREE.BoxGeometry(length + thickness, thickness, height)
    .translate(0, 0, height / 2)
    .rotateZ(Math.atan2(b[1] - a[1], b[0] - a[0]))
    .translate((a[0] + b[0]) / 2, (a[1] + b[1]) / 2, 0);
}

// A wall whose cut is dark, so that rooms are seen from above.
function cutWall(a, b, height) {
  const cut = slab(a, b, CUT_M, WALL_M + 0.002).translate(0, 0, height - CUT_M + 0.001);
  return [[slab(a, b, height), COLORS.wall], [cut, COLORS.cut]];
}

function solid(object, height) {
  const [a, b] = object.polygon;
  return object.polygon.length > 2 ? prism(object.polygon, height) : slab(a, b, height, 0.05);
}

function shaftWalls(elevator, height) {
  const pieces = [];
  elevator.polygon.forEach((corner, index) => {
    const next = elevator.polygon[(index + 1) % elevator.polygon.length];
    for (const [a, b] of withoutDoors(corner, next, elevator.doors)) pieces.push([slab(a, b, height, SHAFT_WALL_M), COLORS.shaft]);
  });
  return pieces;
}

// What the doors on a side leave of it.
function withoutDoors(a, b, doors) {
  const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
  const [ux, uy] = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
  const gaps = doors
    .map((door) => door.map(([x, y]) => [x - a[0], y - a[1]]))
    .map((door) => door.map(([dx, dy]) => [dx * ux + dy * uy, Math.abs(dx * uy - dy * ux)]))
    .filter((ends) => ends.every(([, away]) => away < 0.05))
    .map((ends) => ends.map(([along]) => along).sort((one, other) => one - other))
    .sort((one, other) => one[0] - other[0]);
  const point = (along) => [a[0] + along * ux, a[1] + along * uy];
  const pieces = [];
  let from = 0;
  for (const [start, end] of gaps) {
    if (start > from + 0.01) pieces.push([point(from), point(start)]);
    from = Math.max(from, end);
  }
  if (length > from + 0.01) pieces.push([point(from), point(length)]);
  return pieces;
}

// How high an object is held above the floor [m].
function heldAt(body, { height, reach }, hands) {
  let lift = 0;
  for (const hand of hands) {
    const above = hand.z - height;
    const isNear = Math.hypot(hand.x - body.x, hand.y - body.y) < reach;
    if (isNear && above > 0 && above < HELD_M) lift = Math.max(lift, above);
  }
  return lift;
}

// The cabin of an elevator: its ground and a low rim.
function cabinParts(elevator) {
  const [x0, y0] = elevator.at;
  const inwards = ([x, y]) => {
    const share = 1 - CABIN_GAP_M / Math.hypot(x - x0, y - y0);
    return [x0 + share * (x - x0), y0 + share * (y - y0)];
  };
  const pieces = [[prism(elevator.polygon.map(inwards), 0.03), COLORS.cabin]];
  elevator.polygon.forEach((corner, index) => {
    const next = elevator.polygon[(index + 1) % elevator.polygon.length];
    const sides = withoutDoors(corner, next, elevator.doors);
    for (const [a, b] of sides) pieces.push([slab(inwards(a), inwards(b), 0.25, 0.03), COLORS.cabin]);
  });
  return pieces;
}

function circle(radius) {
  const angles = Array.from({ length: 20 }, (_, k) => (k * Math.PI) / 10);
  return angles.map((angle) => [radius * Math.cos(angle), radius * Math.sin(angle)]);
}
