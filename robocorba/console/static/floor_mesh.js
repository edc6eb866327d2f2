// A floor's map as meshes for three.js: ground, walls cut at a height, objects, shafts, and doors of elevators that move.
import { THREE } from "nicegui-scene";
import { merged } from "/static/robot_model.js";

const WALL_M = 0.10, CUT_M = 0.03;
const COLORS = {
  ground: [0.90, 0.91, 0.92], wall: [0.83, 0.82, 0.79], cut: [0.33, 0.34, 0.36], object: [0.55, 0.58, 0.62], door: [0.10, 0.45, 0.70],
  locked: [0.69, 0.0, 0.41], shaft: [0.66, 0.68, 0.70], cabin: [0.90, 0.72, 0.0],
};

export class FloorMesh {
  // z: height at which the floor is drawn [m].
  constructor(plan, cutHeight, z) {
    this.plan = plan;
    this.group = new THREE.Group();
    this.group.position.z = z;
    this.material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide });
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
    this.mesh = new THREE.Mesh(merged(pieces), this.material);
    this.mesh.matrixAutoUpdate = false;
    this.group.add(this.mesh);
    this.buildDoors(Math.min(2, cutHeight));
  }

  buildDoors(height) {
    this.doors?.removeFromParent();
    this.doors = new THREE.Group();
    this.leaves = [];
    const material = new THREE.MeshLambertMaterial({ color: 0x1b74b3 });
    const ground = new THREE.MeshLambertMaterial({ color: 0xe6b800 });
    for (const elevator of this.plan.elevators) {
      const cabin = new THREE.Mesh(prism(elevator.polygon, 0.03), ground);
      cabin.visible = false;
      this.doors.add(cabin);
      for (const [a, b] of elevator.doors) {
        const width = Math.hypot(b[0] - a[0], b[1] - a[1]);
        const angle = Math.atan2(b[1] - a[1], b[0] - a[0]);
        const leaves = [0, 1].map(() => new THREE.Mesh(new THREE.BoxGeometry(width / 2, 0.05, height), material));
        for (const leaf of leaves) {
          leaf.rotation.z = angle;
          this.doors.add(leaf);
        }
        this.leaves.push({ elevator: elevator.name, a, b, width, angle, leaves, height, cabin });
      }
    }
    this.group.add(this.doors);
    this.setElevators({});
  }

  // states: of elevators by name, as in the frames of live floors.
  setElevators(states) {
    for (const { elevator, a, b, width, angle, leaves, height, cabin } of this.leaves) {
      const state = states[elevator];
      const isHere = state?.cabin === this.plan.name;
      cabin.visible = isHere;
      const opening = isHere ? state.opening : 0;
      [a, b].forEach((end, side) => {
        const along = (side ? -1 : 1) * (width / 4) * (1 - opening);
        const scale = Math.max(1 - opening, 0.02);
        leaves[side].scale.x = scale;
        leaves[side].position.set(end[0] + along * Math.cos(angle), end[1] + along * Math.sin(angle), height / 2);
      });
    }
  }

  // bodies: movable objects of a live floor. Their heights are those of the map.
  setObjects(bodies) {
    const present = new Set();
    for (const body of bodies) {
      present.add(body.number);
      let mesh = this.movables.get(body.number);
      if (!mesh) {
        const known = this.plan.objects.find((object) => object.name === body.name || body.name.endsWith(`/${object.name}`));
        const points = body.outline.length ? body.outline : circle(body.radius);
        mesh = new THREE.Mesh(prism(points, known?.height ?? 0.75), new THREE.MeshLambertMaterial({ color: 0xb5651d }));
        mesh.userData.name = body.name;
        this.movables.set(body.number, mesh);
        this.group.add(mesh);
      }
      mesh.position.set(body.x, body.y, 0);
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

  close() {
    this.group.traverse((object) => object.geometry?.dispose());
    this.group.removeFromParent();
  }
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
  return object.polygon.length > 2 ? prism(object.polygon, height) : slab(object.polygon[0], object.polygon[1], height, 0.05);
}

function shaftWalls(elevator, height) {
  const pieces = [];
  elevator.polygon.forEach((corner, index) => {
    const next = elevator.polygon[(index + 1) % elevator.polygon.length];
    for (const [a, b] of withoutDoors(corner, next, elevator.doors)) pieces.push([slab(a, b, height), COLORS.shaft]);
  });
  return pieces;
}

// What the doors on a side leave of it.
function withoutDoors(a, b, doors) {
  const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
  const [ux, uy] = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
  const gaps = doors
    .map((door) => door.map(([x, y]) => [(x - a[0]) * ux + (y - a[1]) * uy, Math.abs((x - a[0]) * uy - (y - a[1]) * ux)]))
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

function circle(radius) {
  return Array.from({ length: 20 }, (_, k) => [radius * Math.cos((k * Math.PI) / 10), radius * Math.sin((k * Math.PI) / 10)]);
}
