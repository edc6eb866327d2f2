// Articulated robots and plain bodies for three.js, from the part list of the server (robot/kinematics/appearance.py).
import { THREE } from "nicegui-scene";
import { DISPLAYS } from "/static/robot_display.js";
import { wrapped } from "/static/texts.js";

const SEGMENTS = 20;
// Segments of plain bodies, and the volume of the boxes around the parts that they have [m^3].
const COARSE_SEGMENTS = 7, COARSE_VOLUME = 9e-4;

// Merge geometries into one with a colour at each vertex. pieces: [geometry, colour].
export function merged(pieces) {
  const count = pieces.reduce((sum, [geometry]) => sum + geometry.attributes.position.count, 0);
  const [positions, normals, colors] = [0, 1, 2].map(() => new Float32Array(3 * count));
  const indices = [];
  let offset = 0;
  for (const [geometry, color] of pieces) {
    const { position, normal } = geometry.attributes;
    positions.set(position.array, 3 * offset);
    normals.set(normal.array, 3 * offset);
    const linear = new THREE.Color().setRGB(...color, THREE.SRGBColorSpace).toArray();
    for (let vertex = 0; vertex < position.count; vertex++) {
      colors.set(linear, 3 * (offset + vertex));
      if (!geometry.index) indices.push(offset + vertex);
    }
    for (const vertex of geometry.index?.array ?? []) indices.push(offset + vertex);
    offset += position.count;
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(colors, 3));
  geometry.setIndex(indices);
  return geometry;
}

function partGeometry(part, segments = SEGMENTS) {
  let geometry;
  if (part.shape === "box") {
    geometry = new THREE.BoxGeometry(...part.size);
  } else if (part.shape === "ellipsoid") {
    geometry = new THREE.SphereGeometry(1, segments, Math.ceil(segments / 2)).scale(...part.size);
  } else {
    const [x, y, top, height] = part.size;
    geometry = new THREE.CylinderGeometry(top, 1, height, segments).rotateX(Math.PI / 2).scale(x, y, 1);
    geometry.computeVertexNormals();
  }
  const [roll, pitch, yaw] = part.rpy;
  geometry.applyMatrix4(new THREE.Matrix4().makeRotationFromEuler(new THREE.Euler(roll, pitch, yaw, "ZYX")));
  return geometry.translate(...part.at);
}

let loading;

// The robot's shape, loaded once a page. Throws an Error if the server has none; then the next call tries again.
export function loadRobotShape() {
  loading ??= fetch("/robot-model")
    .then(async (answer) => {
      if (!answer.ok) throw new Error("the robot's model is not available");
      return new RobotShape(await answer.json());
    })
    .catch((error) => {
      loading = undefined;
      throw error;
    });
  return loading;
}

// Geometry of the links, shared by all robots.
export class RobotShape {
  constructor(model) {
    this.model = model;
    this.geometries = new Map();
    this.display = model.parts.find((part) => part.paint === "display");
    for (const link of model.links) {
      const pieces = model.parts
        .filter((part) => part.link === link.name)
        .map((part) => [partGeometry(part), model.paints[part.paint]]);
      if (pieces.length) this.geometries.set(link.name, merged(pieces));
    }
    // The display's picture is on its front, which faces ahead.
    const [depth, width, height] = this.display.size;
    const upright = new THREE.Matrix4().makeBasis(
      new THREE.Vector3(0, 1, 0), new THREE.Vector3(0, 0, 1), new THREE.Vector3(1, 0, 0),
    );
    this.displayGeometry = new THREE.PlaneGeometry(width, height)
      .applyMatrix4(upright)
      .translate(depth / 2 + 0.001, 0, 0);
    this.plain = plainGeometry(model);
    this.material = new THREE.MeshLambertMaterial({ vertexColors: true });
    this.ghostMaterial = new THREE.MeshLambertMaterial({
      color: 0xa878d8, transparent: true, opacity: 0.45, polygonOffset: true, polygonOffsetFactor: -1,
    });
  }
}

// A robot whose links move with its joints. `group` stands on the floor at the robot's pose.
export class ArticulatedRobot {
  constructor(shape, { isGhost = false } = {}) {
    this.shape = shape;
    this.group = new THREE.Group();
    this.links = new Map();
    this.turns = [];
    for (const link of shape.model.links) {
      const parent = link.parent ? this.links.get(link.parent) : this.group;
      let frame = new THREE.Group();
      frame.position.set(...link.at);
      parent.add(frame);
      // MuJoCo turns about an axis through a point of the link's frame, one joint after the other.
      for (const joint of link.joints) {
        const pivot = new THREE.Group(), back = new THREE.Group();
        pivot.position.set(...joint.at);
        back.position.set(-joint.at[0], -joint.at[1], -joint.at[2]);
        frame.add(pivot);
        pivot.add(back);
        this.turns.push({ pivot, axis: new THREE.Vector3(...joint.axis), number: joint.number });
        frame = back;
      }
      this.links.set(link.name, frame);
      const geometry = shape.geometries.get(link.name);
      if (geometry) frame.add(new THREE.Mesh(geometry, isGhost ? shape.ghostMaterial : shape.material));
    }
    if (!isGhost) this.addDisplay();
  }

  addDisplay() {
    const { display, displayGeometry } = this.shape;
    const canvas = document.createElement("canvas");
    canvas.width = 256;
    canvas.height = 180;
    this.screen = canvas.getContext("2d");
    this.texture = new THREE.CanvasTexture(canvas);
    this.texture.colorSpace = THREE.SRGBColorSpace;
    this.front = new THREE.MeshBasicMaterial({ map: this.texture });
    const mesh = new THREE.Mesh(displayGeometry, this.front);
    mesh.position.set(...display.at);
    mesh.rotation.set(...display.rpy, "ZYX");
    this.links.get(display.link).add(mesh);
    this.panel = mesh;
    this.show("", "");
  }

  // Write a display on the robot's touch panel: kind is working, waiting or exceptional, as in the paper, or "".
  show(kind, text) {
    if (this.shown === `${kind} ${text}` || !this.screen) return;
    this.shown = `${kind} ${text}`;
    const { screen } = this;
    const [color, sign] = DISPLAYS[kind];
    screen.fillStyle = color;
    screen.fillRect(0, 0, 256, 180);
    screen.fillStyle = "#ffffff";
    screen.textAlign = "center";
    screen.textBaseline = "middle";
    screen.font = "bold 36px sans-serif";
    screen.fillText(`${sign} ${kind}`, 128, 34, 244);
    screen.font = "25px sans-serif";
    for (const [row, line] of wrapped(screen, text, 244).slice(0, 4).entries()) {
      screen.fillText(line, 128, 78 + 29 * row, 244);
    }
    this.texture.needsUpdate = true;
  }

  // Where a mount (such as left_hand) is in the robot's frame: {position, quaternion}.
  mount(name) {
    const { link, at, attitude } = this.shape.model.mounts.find((mount) => mount.name === name);
    this.group.updateMatrixWorld(true);
    const own = new THREE.Matrix4().compose(
      new THREE.Vector3(...at),
      new THREE.Quaternion(attitude[1], attitude[2], attitude[3], attitude[0]),
      new THREE.Vector3(1, 1, 1),
    );
    const pose = this.group.matrixWorld.clone().invert().multiply(this.links.get(link).matrixWorld).multiply(own);
    const found = { position: new THREE.Vector3(), quaternion: new THREE.Quaternion() };
    pose.decompose(found.position, found.quaternion, new THREE.Vector3());
    return found;
  }

  // joints: angles [rad] in the order of the model.
  pose(joints) {
    for (const { pivot, axis, number } of this.turns) pivot.quaternion.setFromAxisAngle(axis, joints[number] ?? 0);
  }

  close() {
    this.group.removeFromParent();
    this.texture?.dispose();
    this.front?.dispose();
  }
}

// A robot at rest in one piece and with few faces, for robots far away.
function plainGeometry(model) {
  const origins = new Map();
  for (const { name, parent, at } of model.links) {
    const from = origins.get(parent) ?? [0, 0, 0];
    origins.set(name, at.map((value, axis) => value + from[axis]));
  }
  const isSeen = ({ shape, size }) => {
    const sides = shape === "box" ? size : size.map((radius) => 2 * radius);
    const [x, y, z] = shape === "cone" ? [sides[0], sides[1], size[3]] : sides;
    return x * y * z > COARSE_VOLUME;
  };
  const pieces = model.parts.filter(isSeen).map((part) => [
    partGeometry(part, COARSE_SEGMENTS).translate(...origins.get(part.link)),
    model.paints[part.paint],
  ]);
  return merged(pieces);
}

// All robots far away, in one draw call.
export class PlainRobots {
  constructor(shape, capacity = 16) {
    this.geometry = shape.plain;
    this.material = shape.material;
    this.group = new THREE.Group();
    this.grow(capacity);
  }

  grow(capacity) {
    this.mesh?.removeFromParent();
    this.mesh?.dispose();
    this.mesh = new THREE.InstancedMesh(this.geometry, this.material, capacity);
    this.mesh.frustumCulled = false;
    this.capacity = capacity;
    this.group.add(this.mesh);
  }

  // robots: [{x, y, z, heading, isLost}].
  set(robots) {
    if (robots.length > this.capacity) this.grow(2 * robots.length);
    const matrix = new THREE.Matrix4(), color = new THREE.Color();
    robots.forEach((robot, index) => {
      matrix.makeRotationZ(robot.heading).setPosition(robot.x, robot.y, robot.z);
      this.mesh.setMatrixAt(index, matrix);
      this.mesh.setColorAt(index, color.set(robot.isLost ? 0x777777 : 0xffffff));
    });
    this.mesh.count = robots.length;
    this.mesh.instanceMatrix.needsUpdate = true;
    if (this.mesh.instanceColor) this.mesh.instanceColor.needsUpdate = true;
  }
}
