// A robot whose hand follows a target: dragged with the pointer or moved by steps, solved by the server while it moves.
import { THREE } from "nicegui-scene";
import { call } from "/static/live.js";

// Interval between requests for joints [ms]; one is under way at a time, and only the newest target is asked for.
const INTERVAL_MS = 100;
// Distance from the handle at which the pointer takes it [px].
const GRASP_PX = 22;
// An answer that takes longer is announced [ms].
const LATE_MS = 800;
const REACHABLE = 0xd55e00, UNREACHABLE = 0xb00068;

export class HandTarget {
  // robot: an ArticulatedRobot. view: a SceneView. changed(result): it was reached, see arm_poser.js.
  // notify(problem): why it was not, or "". redraw(): something to draw has changed.
  constructor(robot, view, { changed, notify, redraw }) {
    Object.assign(this, { robot, view, changed, notify, redraw });
    this.options = { side: "left", with_attitude: true, use_lumbar: false };
    this.joints = [];
    this.posture = 0; // counts the calls of set(): answers for an earlier posture are ignored
    this.position = new THREE.Vector3();
    this.quaternion = new THREE.Quaternion();
    this.handle = handle();
    robot.group.add(this.handle);
    this.listeners = [
      ["pointerdown", (event) => this.grasp(event)],
      ["pointermove", (event) => this.drag(event)],
      ["pointerup", () => this.release()],
      ["pointercancel", () => this.release()],
    ];
    // The first call takes seconds: better before it matters.
    call("hand_poses", { joints: new Array(18).fill(0) }).catch(() => {});
    // In the phase of capture: before the orbit controls, which would turn the camera.
    this.canvas = view.canvas;
    for (const [kind, listener] of this.listeners) this.canvas.addEventListener(kind, listener, { capture: true });
  }

  // The robot stands like this from now on. options: side, with_attitude, use_lumbar.
  set(joints, options = {}) {
    this.joints = [...joints];
    Object.assign(this.options, options);
    this.posture++;
    this.isWanted = this.isMissed = false;
    this.robot.pose(this.joints);
    this.backToHand();
    this.notify("");
  }

  get hand() {
    return this.options.side === "right" ? "right" : "left";
  }

  backToHand() {
    const { position, quaternion } = this.robot.mount(`${this.hand}_hand`);
    this.position.copy(position);
    this.quaternion.copy(quaternion);
    this.place(REACHABLE);
  }

  place(color) {
    this.handle.position.copy(this.position);
    this.handle.quaternion.copy(this.quaternion);
    for (const part of this.handle.children) part.material.color.set(color);
    this.redraw();
  }

  // Move along the robot's axes [m]: ahead, to the left, up.
  move(ahead, left, up) {
    this.position.add(new THREE.Vector3(ahead, left, up));
    this.want();
  }

  // Turn [rad]: roll about the direction of the hand, pitch about the hand's side, yaw about the vertical.
  turn(roll, pitch, yaw) {
    const turned = (x, y, z, angle) => new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3(x, y, z), angle);
    this.quaternion.multiply(turned(1, 0, 0, roll)).multiply(turned(0, 1, 0, pitch)).premultiply(turned(0, 0, 1, yaw));
    this.want();
  }

  // Its pose as the icon mhand_pose has it.
  get pose() {
    const { x, y, z } = this.position;
    const euler = new THREE.Euler().setFromQuaternion(this.quaternion, "ZYX");
    return { x, y, z, roll: euler.x, pitch: euler.y, yaw: euler.z };
  }

  onScreen(event) {
    const box = this.view.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  grasp(event) {
    const [x, y] = this.onScreen(event);
    const at = this.handle.getWorldPosition(new THREE.Vector3());
    const seen = this.view.onCanvas(at);
    if (event.button !== 0 || !seen || Math.hypot(seen[0] - x, seen[1] - y) > GRASP_PX) return;
    event.stopImmediatePropagation();
    this.view.canvas.focus();
    this.view.canvas.setPointerCapture(event.pointerId);
    this.view.orbit.enabled = false;
    const ahead = this.view.camera.getWorldDirection(new THREE.Vector3());
    this.plane = new THREE.Plane().setFromNormalAndCoplanarPoint(ahead, at);
  }

  drag(event) {
    if (!this.plane) return;
    event.stopImmediatePropagation();
    const point = this.view.rayAt(this.onScreen(event)).ray.intersectPlane(this.plane, new THREE.Vector3());
    if (!point) return;
    this.position.copy(this.robot.group.worldToLocal(point));
    this.want();
  }

  release() {
    if (!this.plane) return;
    this.plane = null;
    this.view.orbit.enabled = true;
    if (this.isMissed && !this.isWanted && !this.isAsking) this.backToHand();
  }

  want() {
    this.isWanted = true;
    this.place(this.isMissed ? UNREACHABLE : REACHABLE);
    this.ask();
  }

  async ask() {
    if (this.isAsking || !this.isWanted) return;
    this.isAsking = true;
    this.isWanted = false;
    const began = performance.now();
    const { pose, options, posture } = this, isValid = () => !this.isClosed && posture === this.posture;
    const late = setTimeout(() => isValid() && this.notify("the console is computing the arm"), LATE_MS);
    try {
      const answer = await call("solve_hand", { joints: this.joints, pose, ...options });
      clearTimeout(late);
      if (isValid()) this.reached(answer);
    } catch (error) {
      clearTimeout(late);
      if (isValid()) this.missed(error.message);
    }
    setTimeout(() => {
      this.isAsking = false;
      if (!this.isClosed) this.ask();
    }, Math.max(0, INTERVAL_MS - (performance.now() - began)));
  }

  reached({ joints, hands }) {
    this.isMissed = false;
    this.joints = joints;
    this.robot.pose(joints);
    if (this.options.with_attitude || this.isWanted || this.plane) this.place(REACHABLE);
    else this.backToHand();
    this.notify("");
    const { side } = this.options;
    const start = side === "right" ? 7 : 0;
    this.changed({ joints, pose: hands[this.hand], side, arm: joints.slice(start, start + 7) });
  }

  missed(problem) {
    this.isMissed = true;
    this.notify(problem);
    this.place(UNREACHABLE);
    if (!this.plane && !this.isWanted) this.backToHand(); // after a step; a drag may still come back into reach
  }

  close() {
    this.isClosed = true;
    if (this.plane) this.release();
    for (const [kind, listener] of this.listeners) this.canvas.removeEventListener(kind, listener, { capture: true });
    this.handle.removeFromParent();
    for (const part of this.handle.children) {
      part.geometry.dispose();
      part.material.dispose();
    }
  }
}

// A ball at the hand's control point and an arrow in the direction of the hand; seen through the robot.
function handle() {
  const group = new THREE.Group();
  const material = () => new THREE.MeshBasicMaterial({ depthTest: false, transparent: true, opacity: 0.85 });
  const ball = new THREE.SphereGeometry(0.028, 16, 10);
  const shaft = new THREE.CylinderGeometry(0.006, 0.006, 0.10, 8).rotateZ(-Math.PI / 2).translate(0.06, 0, 0);
  const tip = new THREE.ConeGeometry(0.018, 0.04, 12).rotateZ(-Math.PI / 2).translate(0.13, 0, 0);
  const thumb = new THREE.BoxGeometry(0.008, 0.008, 0.06).translate(0, 0, 0.05); // which way is up for the hand
  for (const geometry of [ball, shaft, tip, thumb]) {
    const part = new THREE.Mesh(geometry, material());
    part.renderOrder = 10;
    group.add(part);
  }
  return group;
}
