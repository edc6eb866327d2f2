// A pose of a hand or the joints of an arm in 3D: the hand is dragged, and the values go to the icon.
import { ArmPoser } from "/static/arm_poser.js";
import { call, live } from "/static/live.js";
import { fourDigits } from "/static/program_model.js";

const ARM = 7, FIRST = { left: 0, both: 0, right: 7 };
const PLACE = ["x", "y", "z"], ATTITUDE = ["roll", "pitch", "yaw"];

export const PosePicker = {
  components: { ArmPoser },
  // node: a mhand_pose or mhand_joints. robot: its arms are shown as they are until the icon has values.
  props: { node: Object, robot: String },
  emits: ["take"],
  template: `
    <section class="pose-picker" aria-label="Pose in 3D">
      <label v-if="isPose" class="pose-free">
        <input type="checkbox" v-model="isFree" @change="retake"> attitude of the hand is free</label>
      <arm-poser :joints="joints" :side="side" :with-attitude="!isFree || !isPose"
                 @change="posed"></arm-poser>
      <p v-if="problem" class="icon-reason is-error">{{ problem }}</p>
    </section>`,
  data() {
    return { joints: [], isFree: false, problem: "" };
  },
  computed: {
    isPose() {
      return this.node.icon === "mhand_pose";
    },
    side() {
      return this.node.values.hand ?? "left";
    },
    // What the icon has, as text: it changes when the icon does.
    given() {
      return JSON.stringify([this.node.id, this.node.values]);
    },
  },
  watch: {
    given(given) {
      if (given !== this.taken) this.show();
    },
  },
  mounted() {
    this.isFree = this.isPose && this.has(PLACE) && !this.has(ATTITUDE);
    this.show();
  },
  methods: {
    has(names) {
      return names.every((name) => typeof this.node.values[name] === "number");
    },
    // Show the icon's posture; where it has none the robot as it stands.
    async show() {
      const { values } = this.node, { side } = this;
      this.taken = undefined;
      const joints = [...(live.joints(this.robot) ?? [])];
      this.problem = "";
      this.joints = joints;
      if (!this.isPose && values.joints?.length === ARM && values.joints.every((angle) => typeof angle === "number")) {
        const shown = joints.length ? joints : Array(18).fill(0);
        for (const [index, angle] of values.joints.entries()) shown[FIRST[side] + index] = angle;
        if (side === "both") for (const [index, angle] of values.joints.entries()) shown[ARM + index] = angle;
        this.joints = shown;
      } else if (this.isPose && this.has(PLACE) && joints.length) {
        const wanted = this.has(ATTITUDE) ? [...PLACE, ...ATTITUDE] : PLACE;
        const pose = Object.fromEntries(wanted.map((name) => [name, values[name]]));
        const given = this.given;
        try {
          const found = await call("solve_hand", { joints, side, pose, with_attitude: this.has(ATTITUDE) });
          if (given === this.given) this.joints = found.joints;
        } catch (error) {
          if (given === this.given) this.problem = error.message;
        }
      }
    },
    posed({ pose, arm }) {
      this.pose = pose;
      this.problem = "";
      const values = { hand: this.side };
      if (!this.isPose) values.joints = arm.map(fourDigits);
      else for (const name of PLACE) values[name] = fourDigits(pose[name]);
      if (this.isPose) for (const name of ATTITUDE) values[name] = this.isFree ? undefined : fourDigits(pose[name]);
      this.$emit("take", values);
      this.taken = JSON.stringify([this.node.id, this.node.values]);
    },
    retake() {
      if (this.pose) this.posed({ pose: this.pose, arm: [] });
    },
  },
};
