// Simulated time: pause, single steps and pace, for administrators.
import { call, live } from "/static/live.js";

const PACES = [[0.25, "0.25x"], [0.5, "0.5x"], [1, "1x"], [2, "2x"], [5, "5x"], [0, "as fast as possible"]];

export default {
  props: { rights: Object },
  template: `
    <div class="simulation-bar" role="group" aria-label="Simulated time">
      <q-btn dense no-caps outline :icon="state?.paused ? 'play_arrow' : 'pause'" :disable="!mayAct"
             :label="state?.paused ? 'Resume time' : 'Pause time'" :title="why"
             @click="order(state.paused ? 'resume_simulation' : 'pause_simulation')" />
      <q-btn v-if="state?.paused" dense no-caps outline label="Step" :disable="!mayAct" title="0.1 s" @click="step" />
      <select :value="state?.pace ?? 1" :disabled="!mayAct" aria-label="Pace of simulated time" :title="why"
              @change="setPace($event)">
        <option v-for="[pace, text] in paces" :key="pace" :value="pace">time {{ text }}</option>
      </select>
      <span v-if="error" class="is-problem" role="alert" :title="error">{{ error }}</span>
    </div>`,
  data() {
    return { state: null, isConnected: true, error: "" };
  },
  computed: {
    // A server that is late with news of itself may obey all the same, or the order says that it does not answer.
    mayAct() {
      return Boolean(this.rights.administrator && this.state && this.isConnected);
    },
    why() {
      if (!this.rights.administrator) return "pausing needs a console with the rights of an administrator";
      return this.mayAct ? "simulated time, for everybody" : "the console or the simulation server does not answer";
    },
    paces() {
      const pace = this.state?.pace ?? 1;
      return PACES.some(([known]) => known === pace) ? PACES : [[pace, `${pace}x`], ...PACES];
    },
  },
  mounted() {
    this.unlisten = live.listen((kind) => (kind === "state" || kind === "connection") && this.update());
    this.update();
  },
  unmounted() {
    this.unlisten();
  },
  methods: {
    update() {
      this.state = live.state?.server?.state?.state ?? null;
      this.isConnected = live.isConnected;
    },
    step() {
      return this.order("step_simulation", { steps: 5 });
    },
    async setPace(event) {
      await this.order("set_pace", { pace: Number(event.target.value) });
      event.target.value = this.state?.pace ?? 1;
    },
    async order(operation, argument = {}) {
      this.error = "";
      this.error = await call(operation, argument).then(() => "", ({ message }) => message);
      if (!this.error && operation === "set_pace") this.state = { ...this.state, pace: argument.pace };
    },
  },
};
