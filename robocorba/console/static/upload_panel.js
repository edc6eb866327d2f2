// Connects another robot to the agent, actual or virtual, after a confirmation that names robot and adaptor.
import { call } from "/static/live.js";
import { shortened } from "/static/texts.js";

export const VIRTUAL = "simulated";
const HINTS = {
  smartpal: "--naming HOST:PORT, the naming service of the robot",
  corba: "--uri URI, the reference of the adaptor",
};
const STORED = "robocorba-adaptor-arguments";

export const UploadPanel = {
  // current: the adaptor of the robot. canRun: the program can run.
  props: { robot: String, current: String, program: String, canRun: Boolean },
  emits: ["switched", "close"],
  template: `
    <section class="upload-panel" aria-label="Upload to another robot" @keydown.esc="$emit('close')">
      <p>{{ isActual ? "The program leaves the virtual robot" : "The agent goes back to the virtual robot" }}:
        from now on <b>{{ robot }}</b> moves the robot behind the adaptor <b>{{ adaptor || "?" }}</b>
        <template v-if="current"> instead of {{ current }}</template>.</p>
      <label>adaptor <select ref="first" v-model="adaptor" aria-label="Adaptor">
        <option v-for="each in others" :key="each" :value="each">{{ each }}</option></select></label>
      <label class="upload-arguments">its arguments
        <input v-model="words" aria-label="Arguments of the adaptor" :placeholder="hint"></label>
      <q-btn dense no-caps color="warning" text-color="black" :loading="isSwitching" :disable="!adaptor || !canRun"
             @click="upload(true)"
             :label="switching + ' and run \u201c' + shortened(program, 30) + '\u201d'" />
      <q-btn dense no-caps outline :disable="!adaptor || isSwitching"
             :label="switching + ' only'" @click="upload(false)" />
      <q-btn dense no-caps flat label="Cancel" :disable="isSwitching" @click="$emit('close')" />
      <p v-if="problem" class="icon-reason is-error" role="alert">{{ problem }}</p>
      <p v-else-if="isSwitching"
         role="status">switching {{ robot }} to {{ adaptor }}; an actual robot takes some seconds</p>
    </section>`,
  data() {
    return { adaptors: [], adaptor: "", words: "", problem: "", isSwitching: false };
  },
  computed: {
    others() {
      return this.adaptors.filter((each) => each !== this.current);
    },
    isActual() {
      return this.adaptor !== VIRTUAL;
    },
    switching() {
      return `Switch ${shortened(this.robot, 30)} to ${this.adaptor || "?"}`;
    },
    hint() {
      return HINTS[this.adaptor] ?? "";
    },
  },
  watch: {
    adaptor() {
      this.words = this.stored()[this.adaptor] ?? "";
    },
  },
  async mounted() {
    try {
      this.adaptors = await call("adaptors", { robot: this.robot });
      const isBack = this.current !== VIRTUAL && this.others.includes(VIRTUAL);
      this.adaptor = isBack ? VIRTUAL : this.others.find((each) => each === "smartpal") ?? this.others[0] ?? "";
      await this.$nextTick();
      this.$refs.first?.focus();
    } catch (error) {
      this.problem = error.message;
    }
  },
  methods: {
    shortened,
    stored() {
      try {
        return JSON.parse(localStorage.getItem(STORED)) ?? {};
      } catch {
        return {};
      }
    },
    async upload(isRun) {
      const { robot, adaptor } = this;
      this.isSwitching = true;
      this.problem = "";
      try {
        await call("switch_adaptor", { robot, adaptor, arguments: this.words.trim().split(/\s+/).filter(Boolean) });
        localStorage.setItem(STORED, JSON.stringify({ ...this.stored(), [adaptor]: this.words.trim() }));
        this.$emit("switched", { robot, adaptor, isRun });
      } catch (error) {
        this.problem = error.message;
      } finally {
        this.isSwitching = false;
      }
    },
  },
};
