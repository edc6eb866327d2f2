// The header of all pages. The emergency stop acts at once, without a question.
import { keep, kept } from "/static/browser_store.js";
import darkMode from "/static/dark_mode.js";
import { call, live } from "/static/live.js";
import PageKeys from "/static/page_keys.js";

// So long the answer to "stop all" is awaited.
const STOP_MS = 8000;
// Set while a page is left by a key on its link: then the focus is on the link of the new page.
const FOCUS_KEY = "robocorba-focus";

export default {
  mixins: [darkMode],
  components: { PageKeys },
  props: { pages: Array, current: String },
  template: `
    <header class="console-header">
      <span class="console-brand">RoboCorba</span>
      <nav ref="nav" style="display: flex; gap: 2px" aria-label="Pages" @click="noteFocus">
        <a v-for="page in pages" :key="page.address" :href="page.address" :title="page.title"
           :aria-current="page.title === current ? 'page' : undefined">
          <q-icon :name="page.icon" size="18px" /> <span>{{ page.title }}</span>
        </a>
      </nav>
      <span class="console-status" :class="{ 'is-problem': problem }" role="status">{{ problem || summary }}</span>
      <q-btn v-if="stopOfAll" dense no-caps outline label="Release all" :title="stopOfAll" @click="releaseAll" />
      <PageKeys :page="current" />
      <q-btn flat round dense :icon="isDark ? 'light_mode' : 'dark_mode'" :aria-label="isDark ? 'Light' : 'Dark'"
             @click="toggleDark" />
      <q-btn class="console-stop" dense :icon="stopping ? 'hourglass_top' : 'front_hand'" no-caps @click="stopAll"
             :label="stopping ? 'Stopping' : 'Stop all'" aria-label="Emergency stop of all robots" />
    </header>`,
  data() {
    return { problem: "connecting", summary: "", stopOfAll: "", stopping: 0 };
  },
  mounted() {
    this.unlisten = live.listen((kind) => ["state", "connection"].includes(kind) && this.update());
    this.timer = setInterval(() => this.update(), 1000);
    this.handshakeTimer = setInterval(() => this.leaveNiceGui(), 250);
    this.update();
    this.takeFocus();
  },
  unmounted() {
    this.unlisten();
    clearInterval(this.timer);
    clearInterval(this.handshakeTimer);
  },
  methods: {
    // Pages need NiceGUI's own connection no more once they are built; it would reload them, and lose what users have
    // typed, when the console's process was replaced.
    leaveNiceGui() {
      if (!window.did_handshake) return;
      clearInterval(this.handshakeTimer);
      window.socket.disconnect();
    },
    update() {
      const server = live.state?.server;
      if (!live.isConnected) this.problem = live.refusal || "the console does not answer; reconnecting";
      else if (live.problems.floors) this.problem = live.problems.floors;
      else if (live.problems.map) this.problem = live.problems.map;
      else this.problem = server?.problem || live.state?.naming || "";
      const hold = server?.state?.stopOfAll;
      this.stopOfAll = hold?.held ? `All robots are stopped, also those that log on: ${hold.reason}` : "";
      const state = server?.state?.state;
      if (state) {
        const pace = state.paused ? "paused" : `${state.achieved.toFixed(2)} x real time`;
        this.summary = `${state.robots} of at most ${state.limit} robots \u00b7 ${state.time.toFixed(1)} s \u00b7 ${pace}`;
      }
    },
    // It can be pressed again while an answer is awaited.
    async stopAll() {
      this.stopping += 1;
      const problem = await failures("not stopped", call("stop_all", {}, STOP_MS), "robots may still move: ");
      this.say(problem || "all robots are stopped", problem);
      this.stopping -= 1;
    },
    async releaseAll() {
      const problem = await failures("still stopped", call("reset_all"));
      if (problem) this.say(problem, problem);
    },
    // A problem stays until it is closed.
    say(message, isProblem) {
      const options = isProblem ? { type: "negative", timeout: 0, closeBtn: true } : { type: "positive" };
      this.$q.notify({ message, ...options });
    },
    // A press of Enter on a link is a click without a position.
    noteFocus({ detail }) {
      if (detail === 0) keep(FOCUS_KEY, true);
    },
    takeFocus() {
      if (kept(FOCUS_KEY)) this.$refs.nav.querySelector("[aria-current]")?.focus();
      keep(FOCUS_KEY, null);
    },
  },
};

// What has failed of an order to all robots, which is answered by a reason for each robot; "" for nothing.
function failures(what, answer, unanswered = "") {
  const texts = (reasons) => Object.entries(reasons).map(([robot, reason]) => `${robot}: ${reason}`).join("; ");
  return answer.then((found) => texts(found) && `${what}: ${texts(found)}`, ({ message }) => unanswered + message);
}
