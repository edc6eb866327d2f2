// The robots of a 3D scene: the nearest few with all their links, plain bodies for the rest, names, the selected one's
// ring, and its ghost at the end of the path that it drives.
import { THREE } from "nicegui-scene";
import { ArticulatedRobot, PlainRobots } from "/static/robot_model.js";
import { distanceTo } from "/static/segments.js";
import { closeSprite, sizeSprite, textSprite } from "/static/text_sprite.js";

// Articulated robots and names at most; of robots, fewer if drawing is slow.
const MOST = 8, FEWEST = 4, NAMES = 12;
const NAME_HEIGHT_M = 1.42;
const SELECTED = "#0072b2", PLATE = "#20262c", GHOST = 0x8a4fbf;

export class RobotCrowd {
  constructor(view, shape) {
    Object.assign(this, { view, shape });
    this.group = new THREE.Group();
    this.articulated = new Map();
    this.names = new Map();
    this.robots = [];
    this.plain = new PlainRobots(shape);
    this.ring = new THREE.Mesh(
      new THREE.RingGeometry(0.44, 0.52, 40),
      new THREE.MeshBasicMaterial({ color: SELECTED, side: THREE.DoubleSide, transparent: true, opacity: 0.9 }),
    );
    this.ring.visible = false;
    this.wayMaterial = new THREE.MeshBasicMaterial(
      { color: GHOST, transparent: true, opacity: 0.75, side: THREE.DoubleSide },
    );
    this.group.add(this.plain.group, this.ring);
    view.scene.add(this.group);
    this.hasNames = true;
  }

  // robots: [{name, x, y, z, heading, radius, joints, display: {kind, text}, isLost}]; without joints it stands at rest.
  set(robots, selected) {
    this.robots = robots;
    this.selected = selected;
    this.update();
  }

  robot(name) {
    return this.robots.find((robot) => robot.name === name);
  }

  // Those nearest to the camera, the selected one first.
  nearest() {
    const { x, y, z } = this.view.camera.position;
    const away = (robot) => (robot.x - x) ** 2 + (robot.y - y) ** 2 + (robot.z - z) ** 2;
    const rank = (robot) => (robot.name === this.selected ? -1 : away(robot));
    return [...this.robots].sort((one, other) => rank(one) - rank(other));
  }

  update() {
    const most = this.view.isSoftware || this.view.ratio < 0.8 ? FEWEST : MOST;
    const sorted = this.nearest();
    const near = new Set(sorted.slice(0, most));
    for (const robot of near) this.articulate(robot);
    for (const [name, model] of this.articulated) {
      if ([...near].some((robot) => robot.name === name)) continue;
      model.close();
      this.articulated.delete(name);
    }
    this.plain.set(this.robots.filter((robot) => !near.has(robot)));
    this.setNames(this.hasNames ? sorted.slice(0, NAMES) : []);
    const selected = this.robot(this.selected);
    this.ring.visible = Boolean(selected);
    if (selected) this.ring.position.set(selected.x, selected.y, selected.z + 0.012);
    this.view.redraw();
  }

  articulate({ name, x, y, z, heading, joints, display }) {
    let model = this.articulated.get(name);
    if (!model) {
      model = new ArticulatedRobot(this.shape);
      this.articulated.set(name, model);
      this.group.add(model.group);
    }
    model.group.position.set(x, y, z);
    model.group.rotation.z = heading;
    model.pose(joints ?? []);
    model.show(display.kind, display.text);
  }

  setNames(robots) {
    const wanted = new Set(robots.map((robot) => robot.name));
    for (const [name, sprite] of this.names) {
      if (wanted.has(name) && (name === this.selected) === sprite.userData.isSelected) continue;
      closeSprite(sprite);
      this.names.delete(name);
    }
    for (const { name, x, y, z } of robots) {
      let sprite = this.names.get(name);
      if (!sprite) {
        const isSelected = name === this.selected;
        sprite = textSprite(name, isSelected ? SELECTED : PLATE);
        sprite.userData.isSelected = isSelected;
        this.names.set(name, sprite);
        this.group.add(sprite);
      }
      sprite.position.set(x, y, z + NAME_HEIGHT_M);
      sizeSprite(sprite, this.view.spritePixel);
    }
  }

  // The robot whose body is at a point of the canvas [px], or undefined.
  at([x, y]) {
    let found, nearest = Infinity;
    for (const robot of this.robots) {
      const foot = this.view.onCanvas(new THREE.Vector3(robot.x, robot.y, robot.z));
      const head = this.view.onCanvas(new THREE.Vector3(robot.x, robot.y, robot.z + 1.35));
      if (!foot || !head) continue;
      const height = Math.hypot(head[0] - foot[0], head[1] - foot[1]);
      const away = distanceTo([x, y], foot, head);
      if (away < Math.max(14, 0.3 * height) && away < nearest) [found, nearest] = [robot, away];
    }
    return found;
  }

  // The name of the robot whose touch panel is at a point of the canvas [px], if nothing of a robot is before it.
  panelAt(point) {
    const models = [...this.articulated];
    const [first] = this.view.rayAt(point).intersectObjects(models.map(([, model]) => model.group));
    return first && models.find(([, model]) => model.panel === first.object)?.[0];
  }

  // The ghost of a robot at the end of its path [{x, y, z}] that leads over the shown floors; null: no ghost.
  setGhost(path, heading, joints) {
    this.way?.removeFromParent();
    this.way?.geometry.dispose();
    this.way = null;
    if (!path || path.length < 2) {
      if (this.ghost) this.ghost.group.visible = false;
      return;
    }
    if (!this.ghost) {
      this.ghost = new ArticulatedRobot(this.shape, { isGhost: true });
      this.group.add(this.ghost.group);
    }
    const { x, y, z } = path[path.length - 1];
    this.ghost.group.visible = true;
    this.ghost.group.position.set(x, y, z);
    this.ghost.group.rotation.z = heading;
    this.ghost.pose(joints ?? []);
    this.way = new THREE.Mesh(ribbon(path, 0.05), this.wayMaterial);
    this.group.add(this.way);
  }

  close() {
    for (const model of this.articulated.values()) model.close();
    for (const sprite of this.names.values()) closeSprite(sprite);
    this.setGhost(null);
    this.ghost?.close();
    this.wayMaterial.dispose();
    this.group.removeFromParent();
  }
}

// A flat band along points.
function ribbon(points, width) {
  const positions = [];
  for (let index = 0; index + 1 < points.length; index++) {
    const a = points[index], b = points[index + 1];
    const length = Math.hypot(b.x - a.x, b.y - a.y);
    if (length < 1e-6) continue;
    const [nx, ny] = [(-(b.y - a.y) / length) * (width / 2), ((b.x - a.x) / length) * (width / 2)];
    const corner = (point, side) => [point.x + side * nx, point.y + side * ny, point.z + 0.02];
    const [a1, a2, b1, b2] = [corner(a, 1), corner(a, -1), corner(b, 1), corner(b, -1)];
    positions.push(...a1, ...a2, ...b1, ...b1, ...a2, ...b2);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(positions, 3));
  return geometry;
}
