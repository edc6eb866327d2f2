// Connects another robot to the agent, actual or virtual, after a confirmation that names robot and adaptor.
import { attempt, call } from "/static/live.js";
import { AddressFields, isAddress, lastAddress, rememberAddress } from "/static/robot_address.js";
import { shortened } from "/static/texts.js";

export const VIRTUAL = "simulated";
// Adaptors whose argument is an address, and what listens there.
const ADDRESSED = { smartpal: "the robot's naming service" };
// Adaptors whose argument is the reference of an object.
const REFERRED = ["corba"];

export const SwitchPanel = {
  components: { AddressFields },
  // current: the adaptor of the robot. canRun: the program can run.
  props: { robot: String, current: String, program: String, canRun: Boolean },
  emits: ["switched", "close"],
  template: `
    <section class="upload-panel" aria-label="Switch to another robot" @keydown.esc="$emit('close')">
      <p>{{ isActual ? "The agent leaves the virtual robot" : "The agent goes back to the virtual robot" }}:
        from now on <b>{{ robot }}</b> moves the robot behind the adaptor <b>{{ adaptor || "?" }}</b>
        <template v-if="current"> instead of {{ current }}</template>.</p>
      <label>adaptor <select ref="first" v-model="adaptor" aria-label="Adaptor">
        <option v-for="each in others" :key="each" :value="each">{{ each }}</option></select></label>
      <address-fields v-if="listener" :address="address" :what="listener"></address-fields>
      <label v-else-if="isReferred" class="upload-arguments">reference of the adaptor
        <input v-model="reference" aria-label="Reference of the adaptor" placeholder="IOR:, corbaloc: or corbaname:"></label>
      <q-btn dense no-caps color="warning" text-color="black" :loading="isSwitching" :disable="!canSwitch || !canRun"
             @click="connect(true)"
             :label="switching + ' and run \u201c' + shortened(program, 30) + '\u201d'" />
      <q-btn dense no-caps outline :disable="!canSwitch || isSwitching"
             :label="switching + ' only'" @click="connect(false)" />
      <q-btn dense no-caps flat label="Cancel" :disable="isSwitching" @click="$emit('close')" />
      <p v-if="problem" class="icon-reason is-error" role="alert">{{ problem }}</p>
      <p v-else-if="isSwitching"
         role="status">switching {{ robot }} to {{ adaptor }}; an actual robot takes some seconds</p>
    </section>`,
  data() {
    const address = { host: "", port: "" };
    return { adaptors: [], adaptor: "", address, reference: "", problem: "", isSwitching: false };
  },
  computed: {
    others() {
      return this.adaptors.filter((each) => each !== this.current);
    },
    isActual() {
      return this.adaptor !== VIRTUAL;
    },
    listener() {
      return ADDRESSED[this.adaptor] ?? "";
    },
    isReferred() {
      return REFERRED.includes(this.adaptor);
    },
    canSwitch() {
      if (this.listener) return isAddress(this.address);
      return Boolean(this.adaptor) && (!this.isReferred || Boolean(this.reference.trim()));
    },
    arguments() {
      const host = this.address.host.trim();
      const address = `${host.includes(":") ? `[${host}]` : host}:${this.address.port}`;
      if (this.listener) return ["--naming", address];
      return this.isReferred ? ["--uri", this.reference.trim()] : [];
    },
    switching() {
      return `Switch ${shortened(this.robot, 30)} to ${this.adaptor || "?"}`;
    },
  },
  watch: {
    adaptor() {
      this.address = lastAddress(this.adaptor);
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
    async connect(isRun) {
      const { robot, adaptor } = this;
      await attempt(this, async () => {
        await call("switch_adaptor", { robot, adaptor, arguments: this.arguments });
        if (this.listener) rememberAddress(adaptor, this.address);
        this.$emit("switched", { robot, adaptor, isRun });
      }, { busy: "isSwitching" });
    },
  },
};
