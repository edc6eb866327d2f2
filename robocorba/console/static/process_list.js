// The processes of the supervisor: their state and their logs, robots to start and to end.
import { attempt, call } from "/static/live.js";
import { ageText } from "/static/robot_rows.js";
import { sharedView } from "/static/shared_view.js";
import SureButton from "/static/sure_button.js";

const REFRESH_MS = 1000;
const LOG_LINES = 200;

export default {
  components: { SureButton },
  props: { floors: Array, channels: Array, rights: Object, picked: Object, isPicking: Boolean },
  emits: ["pick", "processes"],
  template: `
    <section aria-label="Processes">
      <form class="start-form" @submit.prevent="start">
        <label class="wide">New robot <input v-model.trim="order.name" required maxlength="60"
               placeholder="name, such as R5"></label>
        <label>floor <select v-model="order.floor"><option value="">lowest</option>
          <option v-for="floor in floors" :key="floor">{{ floor }}</option></select></label>
        <label>channel <select v-model="order.channel"><option value="">none</option>
          <option v-for="channel in channels" :key="channel">{{ channel }}</option></select></label>
        <div class="start-place"><span>{{ place }}</span>
          <q-btn dense no-caps outline icon="place" label="Pick its place on the map" :aria-pressed="isPicking"
                 @click="pick" />
          <q-btn v-if="order.at" dense no-caps outline label="Use the first free node" @click="order.at = null" /></div>
        <q-btn dense no-caps color="primary" type="submit" label="Start" :loading="isStarting"
               :disable="!rights.supervisor" />
      </form>
      <p v-if="error" class="panel-error is-problem" role="alert">{{ error }}</p>
      <p v-if="isPicking" class="panel-note" role="status">Click a free place on the map; Escape cancels.</p>
      <p v-if="problem" class="panel-note">{{ problem }}</p>
      <table v-if="rows.length" class="console-table">
        <thead><tr><th>Process</th><th>State</th><th>Since</th><th>Starts</th><th></th></tr></thead>
        <tbody><tr v-for="row in rows" :key="row.name" tabindex="0" :aria-selected="row.name === logOf"
                   :title="row.problem || row.name"
                   @click="showLog(row.name)" @keydown.enter="showLog(row.name)">
          <td>{{ row.name }}</td>
          <td :class="{ 'is-problem': row.problem }">{{ [row.phase, row.problem].filter(Boolean).join(", ") }}</td>
          <td>{{ row.since ? since(row) : "" }}</td><td>{{ row.restarts + 1 }}</td>
          <td><SureButton v-if="row.robot" label="End" :question="'End?'" :title="'End robot ' + row.robot"
                          @sure="end(row.robot)" @click.stop /></td>
        </tr></tbody>
      </table>
      <p v-if="past" class="panel-note" :class="{ 'is-problem': past.problem }">The past: {{ past.problem
        ? 'in memory only: ' + past.problem : past.mib.toFixed(1) + ' MiB on disk' }}</p>
      <template v-if="logOf">
        <h2 class="console-heading">Log of {{ logOf }}</h2>
        <pre class="process-log" tabindex="0">{{ log }}</pre>
      </template>
    </section>`,
  data() {
    return {
      rows: [], problem: "loading", error: "", isStarting: false, past: null, logOf: "", log: "",
      order: { name: "", floor: sharedView.floor, channel: "", at: null },
    };
  },
  computed: {
    place() {
      if (!this.order.at) return "It starts at the first free node of the floor.";
      return `It starts at ${this.order.at.map((metres) => metres.toFixed(2)).join(", ")} m.`;
    },
  },
  watch: {
    picked() {
      if (!this.picked) return;
      this.order.floor = this.picked.floor;
      this.order.at = [this.picked.x, this.picked.y];
    },
    // The only channel of a system is the one that is meant.
    channels: {
      immediate: true,
      handler(now, before) {
        if (now.length === 1 && !before?.length) [this.order.channel] = now;
      },
    },
    floors: {
      immediate: true,
      handler() {
        if (this.floors.length && !this.floors.includes(this.order.floor)) this.order.floor = "";
      },
    },
    "order.floor"(floor) {
      if (this.order.at && this.picked?.floor !== floor) this.order.at = null;
    },
  },
  mounted() {
    this.refresh();
  },
  unmounted() {
    this.isOver = true;
    clearTimeout(this.timer);
    if (this.isPicking) this.$emit("pick", false);
  },
  methods: {
    async refresh() {
      try {
        this.past = await call("past_on_disk");
        this.rows = await call("processes");
        this.problem = "";
        this.$emit("processes", this.rows);
        if (this.logOf) await this.loadLog();
      } catch (error) {
        this.problem = error.message;
      }
      if (!this.isOver) this.timer = setTimeout(() => this.refresh(), REFRESH_MS);
    },
    since({ since }) {
      return ageText(Math.max(0, Date.now() / 1000 - since));
    },
    pick() {
      this.$emit("pick", !this.isPicking);
    },
    async start() {
      const { name, floor, channel, at } = this.order;
      await attempt(this, async () => {
        await call("start_robot", { name, floor, channel, ...(at ? { x: at[0], y: at[1] } : {}) });
        this.order.name = "";
        this.order.at = null;
      }, { busy: "isStarting", problem: "error" });
    },
    async end(robot) {
      this.error = "";
      await call("end_robot", { robot }).catch((error) => { this.error = error.message; });
    },
    showLog(name) {
      this.logOf = this.logOf === name ? "" : name;
      this.log = "loading";
      if (this.logOf) this.loadLog();
    },
    async loadLog() {
      const name = this.logOf;
      const log = await call("log_lines", { process: name, lines: LOG_LINES })
        .then((lines) => lines.join("\n") || "nothing yet", ({ message }) => message);
      if (name === this.logOf) this.log = log;
    },
  },
};
