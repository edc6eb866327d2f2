// Methods of the 3D page: the camera follows a robot, and what pointer and keys do.
import { THREE } from "nicegui-scene";
import { stepByKey } from "/static/arm_poser.js";
import { live } from "/static/live.js";
import { panelAddress } from "/static/robot_display.js";

// A click is not a drag up to this distance [px].
const CLICK_PX = 5;

export const cameraMethods = {
  // The tools beside the scene, but for those of each view.
  tools() {
    const toggle = (name, icon, title, disable) => ({
      icon, title, disable, isOn: this[name], press: () => { this[name] = !this[name]; },
    });
    return [
      toggle("isFollowing", "my_location", "Follow the robot", !this.selected),
      toggle("hasRays", "sensors", "Rays of the sensors"), toggle("hasNames", "label", "Names"),
      toggle("isPosing", "back_hand", "Pose a hand", !this.selected || !this.past.isLive),
      { icon: "download", title: "The robot as URDF", press: () => window.location.assign("/robot.urdf") },
    ];
  },
  zoom(factor) {
    this.view.turn(0, 0, 1 / factor);
  },
  second() {
    this.say();
    this.updateFacts();
    this.crowd?.update();
  },
  // Go to the robot that was chosen if it is not in the scene.
  find() {
    if (!this.selected || this.crowd?.robot(this.selected)) return;
    this.isFollowing = true;
    this.follow();
  },
  follow() {
    const robot = this.crowd.robot(this.selected);
    if (!this.isFollowing) return;
    if (!robot) {
      this.findFloor();
      return;
    }
    const { camera, orbit } = this.view;
    const moved = new THREE.Vector3(robot.x, robot.y, robot.z + 0.75).sub(orbit.target);
    if (this.followed !== robot.name) {
      const bearing = robot.heading - 0.55;
      camera.position.set(robot.x + 2.7 * Math.cos(bearing), robot.y + 2.7 * Math.sin(bearing), robot.z + 1.75);
      this.followed = robot.name;
    } else if (moved.length() > 1e-4) {
      camera.position.add(moved);
    } else {
      return;
    }
    orbit.target.add(moved);
    orbit.update();
    this.view.redraw();
  },
  // The followed robot is on another floor: it has taken an elevator.
  findFloor() {
    const floor = live.state?.robots[this.selected]?.state?.at.floor;
    if (!floor || this.isPool || floor === this.current || !this.floors.includes(floor) || this.isStacked) return;
    if (!this.past.isLive) return;
    this.current = floor;
    this.want();
    this.loadPlans();
  },
  pointer(kind, event) {
    if (kind === "pointerdown") this.pressed = [event.offsetX, event.offsetY];
    else if (this.pressed && Math.hypot(event.offsetX - this.pressed[0], event.offsetY - this.pressed[1]) < CLICK_PX) {
      const panel = this.past.isLive && this.crowd?.panelAt([event.offsetX, event.offsetY]);
      if (panel) window.location.assign(panelAddress(panel));
      const robot = this.crowd?.at([event.offsetX, event.offsetY]);
      if (robot) this.selected = robot.name;
    }
  },
  key(event) {
    if (this.target && stepByKey(this.target, event)) return;
    const step = 0.12;
    const turns = {
      ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step],
      "+": [0, 0, 0.85], "-": [0, 0, 1.18],
    };
    if (turns[event.key]) this.view.turn(...turns[event.key]);
    else if (event.key === "0") this.lookAtAll();
    else return;
    event.preventDefault();
  },
};
