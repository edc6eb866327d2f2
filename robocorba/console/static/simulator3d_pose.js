// Methods of the 3D page: pose a hand of the selected robot's ghost.
import { inWords } from "/static/arm_poser.js";
import { HandTarget } from "/static/hand_target.js";
import { ArticulatedRobot } from "/static/robot_model.js";

export const poseMethods = {
  pose() {
    const robot = this.crowd.robot(this.selected);
    if (!robot) {
      this.isPosing = false;
      return;
    }
    if (!this.target) {
      this.figure = new ArticulatedRobot(this.shape, { isGhost: true });
      this.view.scene.add(this.figure.group);
      this.target = new HandTarget(this.figure, this.view, {
        changed: (result) => (this.words = inWords(result.pose)), notify: (problem) => (this.problem = problem),
        redraw: () => this.view.redraw(),
      });
    }
    this.placePose();
    this.target.set(robot.joints?.length ? robot.joints : new Array(18).fill(0), { side: this.side });
    this.words = inWords(this.target.pose);
  },
  placePose() {
    const robot = this.crowd.robot(this.selected);
    if (!robot) return;
    this.figure.group.position.set(robot.x, robot.y, robot.z);
    this.figure.group.rotation.z = robot.heading;
  },
  endPose() {
    this.target?.close();
    this.figure?.close();
    this.target = this.figure = null;
    this.view?.redraw();
  },
};
