// How the robot stands after an icon that names a posture of an arm or bends the body.
import { ArmPoser } from "/static/arm_poser.js";
import { attempt, call, live } from "/static/live.js";

const JOINTS = 18, ARM = 7, LUMBAR = 14;
// Where the angles of an arm begin.
const FIRST = { left: [0], right: [ARM], both: [0, ARM] };

export const PosturePreview = {
  components: { ArmPoser },
  // node: a mhand_posture or lumbar. robot: what the icon doesn't move is shown as it stands.
  props: { node: Object, robot: String },
  template: `
    <section class="posture-preview" aria-label="Preview in 3D">
      <h2 class="console-heading" role="status">{{ caption }}</h2>
      <arm-poser is-still :joints="joints"></arm-poser>
    </section>`,
  data() {
    return { postures: {}, stands: [], problem: "" };
  },
  computed: {
    caption() {
      if (this.problem) return this.problem;
      return this.isShown ? "The robot as it stands, after this icon alone" : "The robot as it stands; choose to see what this icon does";
    },
    isLumbar() {
      return this.node.icon === "lumbar";
    },
    posture() {
      return this.postures[this.node.values.posture];
    },
    isShown() {
      const { lower, upper } = this.node.values;
      return this.isLumbar ? [lower, upper].some((angle) => typeof angle === "number") : Boolean(this.posture);
    },
    joints() {
      const joints = this.stands.length ? [...this.stands] : Array(JOINTS).fill(0), { values } = this.node;
      if (this.isLumbar) {
        ["lower", "upper"].forEach((name, index) => {
          if (typeof values[name] === "number") joints[LUMBAR + index] = values[name];
        });
      } else if (this.posture) {
        for (const first of FIRST[values.hand] ?? FIRST.left) joints.splice(first, ARM, ...this.posture);
      }
      return joints;
    },
  },
  watch: {
    robot: "look",
  },
  mounted() {
    this.look();
    attempt(this, async () => { this.postures = await call("arm_postures"); });
  },
  methods: {
    look() {
      this.stands = [...(live.joints(this.robot) ?? [])];
    },
  },
};
