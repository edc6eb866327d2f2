// A robot in a small 3D view whose hand one drags to where it shall be; the arm follows by inverse kinematics.
//
//   <arm-poser :joints="joints" side="left" @change="poseChanged"></arm-poser>
//
// joints: 18 angles [rad] in the order of the model; none: arms at the posture `ready`. side: left, right, or both: the
// right hand mirrors the left one. with-attitude: false if the hand may turn as it likes. is-still: the robot is only
// shown. change: {joints, pose, side, arm}: what was reached; pose {x, y, z, roll, pitch, yaw} [m, rad] of the (left)
// hand in the robot's frame, arm: the 7 angles of its arm.
import { THREE } from "nicegui-scene";
import { HandTarget } from "/static/hand_target.js";
import { call } from "/static/live.js";
import { ArticulatedRobot, loadRobotShape } from "/static/robot_model.js";
import { SceneView } from "/static/scene_view.js";

const STEP_M = 0.02, STEP_RAD = Math.PI / 36;
// Label, icon, key, and the move (ahead, left, up) or turn (roll, pitch, yaw) of one step.
const STEPS = [
  ["forward", "north", "ArrowUp", "move", [1, 0, 0]],
  ["back", "south", "ArrowDown", "move", [-1, 0, 0]],
  ["to its left", "west", "ArrowLeft", "move", [0, 1, 0]],
  ["to its right", "east", "ArrowRight", "move", [0, -1, 0]],
  ["up", "keyboard_double_arrow_up", "PageUp", "move", [0, 0, 1]],
  ["down", "keyboard_double_arrow_down", "PageDown", "move", [0, 0, -1]],
  ["roll left", "undo", ",", "turn", [-1, 0, 0]],
  ["roll right", "redo", ".", "turn", [1, 0, 0]],
  ["tip up", "vertical_align_top", ";", "turn", [0, -1, 0]],
  ["tip down", "vertical_align_bottom", "'", "turn", [0, 1, 0]],
  ["turn left", "rotate_left", "[", "turn", [0, 0, 1]],
  ["turn right", "rotate_right", "]", "turn", [0, 0, -1]],
];

// Do the step of a key with a HandTarget; whether there is one.
export function stepByKey(target, event) {
  const step = STEPS.find(([, , key]) => key === event.key);
  if (!step || event.ctrlKey || event.metaKey || event.altKey) return false;
  stepBy(target, step);
  event.preventDefault();
  return true;
}

function stepBy(target, [, , , kind, values]) {
  target?.[kind](...values.map((value) => value * (kind === "move" ? STEP_M : STEP_RAD)));
}

// Buttons for the steps of a hand; `target` is a function that gives the HandTarget.
export const HandSteps = {
  props: { target: Function },
  data: () => ({ steps: STEPS }),
  template: `
    <div class="hand-steps" role="group" aria-label="Move the hand">
      <q-btn v-for="step in steps" :key="step[0]" dense flat size="sm" :icon="step[1]" :aria-label="'Hand ' + step[0]"
             :title="step[0] + ' (' + step[2] + ')'" @click="go(step)" />
    </div>`,
  methods: {
    go(step) {
      stepBy(this.target(), step);
    },
  },
};

export const ArmPoser = {
  components: { HandSteps },
  props: {
    joints: { type: Array, default: () => [] },
    side: { type: String, default: "left" },
    withAttitude: { type: Boolean, default: true },
    isStill: Boolean,
  },
  emits: ["change"],
  data: () => ({ problem: "", words: "", message: "loading the robot" }),
  template: `
    <div class="arm-poser">
      <div class="arm-poser-view" ref="view">
        <div v-if="message" class="console-overlay">{{ message }}</div>
        <div v-if="!isStill" class="arm-poser-words" :class="{ 'is-problem': problem }" role="status">
          {{ problem || words }}</div>
      </div>
      <hand-steps v-if="!isStill" :target="() => target"></hand-steps>
    </div>`,
  computed: {
    label() {
      if (this.isStill) return "The robot; drag to look from elsewhere";
      return "The robot; arrows, page up and page down move its hand, brackets turn it";
    },
  },
  async mounted() {
    try {
      const [shape, postures] = await Promise.all([loadRobotShape(), call("arm_postures")]);
      if (this.isGone) return;
      this.ready = [...postures.ready, ...postures.ready, 0, 0, 0, 0];
      this.setUp(shape);
      this.message = "";
    } catch (error) {
      this.message = error.message;
    }
  },
  unmounted() {
    this.isGone = true;
    this.target?.close();
    this.robot?.close();
    this.view?.close();
  },
  methods: {
    setUp(shape) {
      this.view = new SceneView(this.$refs.view, {
        notify: (message) => (this.message = message), key: (event) => this.key(event), pointer: () => {}, moved: () => {},
        remade: () => this.takeCanvas(),
      });
      const { camera, scene, orbit } = this.view;
      camera.position.set(2.1, 1.5, 1.6);
      orbit.target.set(0.15, 0, 0.85);
      orbit.update();
      this.robot = new ArticulatedRobot(shape);
      scene.add(this.robot.group, new THREE.GridHelper(2, 8, 0x888888, 0x888888).rotateX(Math.PI / 2));
      this.takeCanvas();
    },
    takeCanvas() {
      this.target?.close();
      this.view.canvas.setAttribute("aria-label", this.label);
      this.target = this.isStill ? null : new HandTarget(this.robot, this.view, {
        changed: (result) => this.changed(result), notify: (problem) => (this.problem = problem),
        redraw: () => this.view.redraw(),
      });
      this.take();
    },
    take() {
      if (!this.robot) return;
      const joints = this.joints?.length ? this.joints : this.ready;
      if (this.isStill) {
        this.robot.pose(joints);
        this.view.redraw();
        return;
      }
      const options = { side: this.side, with_attitude: this.withAttitude };
      this.target.set(joints, options);
      this.words = inWords(this.target.pose);
    },
    changed(result) {
      this.words = inWords(result.pose);
      this.$emit("change", result);
    },
    key(event) {
      if (this.target) stepByKey(this.target, event);
    },
  },
  watch: {
    joints() { this.take(); },
    side() { this.take(); },
    withAttitude() { this.take(); },
  },
};

export function inWords({ x, y, z, roll, pitch, yaw }) {
  const degrees = [roll, pitch, yaw].map((angle) => `${Math.round((angle * 180) / Math.PI) + 0}\u00b0`);
  return `x ${x.toFixed(2)}  y ${y.toFixed(2)}  z ${z.toFixed(2)} m \u00b7 roll, pitch, yaw ${degrees.join(" ")}`;
}
