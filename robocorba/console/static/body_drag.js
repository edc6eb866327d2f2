// Dragging a robot or an object to another place, for administrators: drawn as it would stand, placed on release.
import { call } from "/static/live.js";

// A shorter drag is a click [px].
const CLICK_PX = 5;
const TURN_RAD = Math.PI / 12;

export class BodyDrag {
  constructor(scene) {
    this.scene = scene;
    this.floor = "";
    this.grip = null;
  }

  get isActive() {
    return this.grip !== null;
  }

  // Take the body at a point of a floor; returns true, which takes the pointer.
  begin(body, point, floor) {
    this.floor = floor;
    this.grip = { body, heading: body.heading, from: point, dx: body.x - point[0], dy: body.y - point[1] };
    return true;
  }

  pointer(kind, point) {
    if (kind === "cancel") this.cancel();
    if (kind === "move") this.move(point);
    if (kind === "up") this.drop();
    return true;
  }

  move([x, y]) {
    const { grip, scene } = this;
    const distance = Math.hypot(x - grip.from[0], y - grip.from[1]) * scene.canvas.scale;
    if (!scene.moved && distance < CLICK_PX) return;
    scene.moved = { body: grip.body, x: x + grip.dx, y: y + grip.dy, heading: grip.heading };
    scene.canvas.redraw();
  }

  turn(direction) {
    this.grip.heading += direction * TURN_RAD;
    this.scene.moved ??= { body: this.grip.body, x: this.grip.body.x, y: this.grip.body.y };
    this.scene.moved.heading = this.grip.heading;
    this.scene.canvas.redraw();
  }

  cancel() {
    this.grip = null;
    this.scene.moved = null;
    this.scene.canvas.redraw();
  }

  async drop() {
    const { moved } = this.scene;
    this.grip = null;
    if (!moved) return;
    const { body, x, y } = moved;
    const heading = Math.atan2(Math.sin(moved.heading), Math.cos(moved.heading));
    await call("place", { body: body.name, floor: this.floor, x, y, heading })
      .catch(({ message }) => this.scene.refuse(message, x, y));
    if (this.scene.moved === moved) this.scene.moved = null;
    this.scene.canvas.redraw();
  }
}
