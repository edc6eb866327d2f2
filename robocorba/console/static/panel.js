// The touch panel of one robot, for a tablet on it: what it does, large; its work model and program; orders; and answers
// to what its program asks. It needs no more than the robot's PIN, so it does without the live connection.
import { callPanel } from "/static/calls.js";
import darkMode from "/static/dark_mode.js";
import { plainWords } from "/static/icon_looks.js";
import { PanelChoice } from "/static/panel_choice.js";
import { DISPLAYS } from "/static/robot_display.js";
import { durationText } from "/static/texts.js";

const EVERY_MS = 400, LIMIT_MS = 4000, STOP_MS = 8000;
// News that are older count as none [s]; how long a message stays [ms].
const OLD_S = 3, MESSAGE_MS = 8000;
const LOADED = "";

export default {
  mixins: [darkMode],
  components: { PanelChoice },
  props: { robot: String },
  template: `
    <div class="panel">
      <section class="panel-display" :class="'is-' + (shown.kind || 'lost')"
               :style="{ background: color }" aria-label="Display">
        <header>
          <bdi class="panel-robot">{{ robot }}</bdi>
          <span class="panel-kind"><span aria-hidden="true">{{ sign }}</span> {{ shown.kind || "no news" }}</span>
          <span class="panel-since">{{ since }}</span>
          <button class="panel-dark" :aria-label="isDark ? 'Light' : 'Dark'" @click="toggleDark">
            <q-icon :name="isDark ? 'light_mode' : 'dark_mode'" /></button>
        </header>
        <p class="panel-text" :class="size" role="status"><span>{{ text }}</span></p>
        <div v-if="isAsking" class="panel-answers">
          <button class="is-yes" :disabled="isBusy" @click="answer(true)"><q-icon name="check" /> Yes</button>
          <button class="is-no" :disabled="isBusy" @click="answer(false)"><q-icon name="close" /> No</button>
        </div>
      </section>
      <section class="panel-work" aria-label="Work">
        <div class="panel-models" role="group" aria-label="Work model">
          <button v-for="each in models" :key="each.adaptor" :aria-pressed="each.adaptor === state.adaptor"
                  :class="{ 'is-sure': sure === each.adaptor }" :disabled="isActive || isBusy || isLost"
                  @click="choose(each)">
            <b>{{ sure === each.adaptor ? "Sure?" : each.model }}</b><small>{{ each.adaptor }}</small></button>
        </div>
        <button class="panel-program" :disabled="isActive || isLost" aria-haspopup="dialog" @click="isChoosing = true">
          <small>program</small><b>{{ programText }}</b><q-icon name="expand_less" /></button>
      </section>
      <section class="panel-orders" aria-label="Orders">
        <button v-for="each in orders" :key="each.label" :class="each.look" :disabled="each.disabled || isBusy || isLost"
                @click="each.act"><q-icon :name="each.icon" /> {{ each.label }}</button>
        <button class="panel-stop" @click="stop"><q-icon name="front_hand" /> {{ isStopping ? "Stopping" : "Stop" }}</button>
      </section>
      <p v-if="message" class="panel-message" role="alert" @click="message = ''">{{ message }}</p>
      <PanelChoice v-if="isChoosing" :choices="choices" :chosen="program" @choose="chosen" @close="isChoosing = false" />
    </div>`,
  data() {
    return {
      state: {}, choices: { adaptors: [], programs: [], loaded: "" }, program: null, isChoosing: false, isBusy: false,
      isStopping: false, message: "", sure: "", problem: "connecting",
    };
  },
  computed: {
    isLost() {
      return Boolean(this.problem);
    },
    shown() {
      return this.isLost ? { kind: "", text: this.problem } : this.state.display;
    },
    color() {
      return DISPLAYS[this.shown.kind][0];
    },
    sign() {
      return DISPLAYS[this.shown.kind][1];
    },
    isAsking() {
      return !this.isLost && this.state.question.number > 0;
    },
    text() {
      return this.isAsking ? this.state.question.text : plainWords(this.shown.text);
    },
    size() {
      const { length } = this.text;
      return length > 120 ? "is-long" : length > 48 ? "is-middle" : "";
    },
    since() {
      return this.isLost ? "" : `for ${durationText(this.shown.seconds + this.state.age)}`;
    },
    isActive() {
      return ["RUNNING", "PAUSED"].includes(this.state.condition);
    },
    isActual() {
      return this.state.adaptor && this.state.adaptor !== "simulated";
    },
    models() {
      const first = [...this.choices.adaptors].sort((one, other) => (other === "simulated") - (one === "simulated"));
      return first.map((adaptor) => ({ adaptor, model: adaptor === "simulated" ? "virtual" : "actual" }));
    },
    programText() {
      if (this.isActive) return this.state.program;
      if (this.program === null) return "choose";
      return this.program || this.choices.loaded;
    },
    orders() {
      const order = (label, icon, name, look = "") => ({ label, icon, look, act: () => this.order(name) });
      const { condition } = this.state;
      if (condition === "STOPPED") return [order("Reset", "restart_alt", "reset", "is-first")];
      if (condition === "RUNNING") return [order("Pause", "pause", "pause", "is-first"), order("End", "stop", "abort")];
      if (condition === "PAUSED") return [order("Go on", "play_arrow", "resume", "is-first"), order("End", "stop", "abort")];
      const look = this.isActual ? "is-actual" : "is-first";
      const label = this.isActual ? "Start the actual robot" : "Start";
      return [{ label, icon: "play_arrow", look, disabled: this.program === null, act: this.start }];
    },
  },
  async mounted() {
    await this.look();
  },
  unmounted() {
    this.isGone = true;
    clearTimeout(this.timer);
    clearTimeout(this.sureTimer);
    clearTimeout(this.messageTimer);
  },
  methods: {
    // What the robot shows; then again after a while.
    async look() {
      try {
        const state = await callPanel("panel", this.robot, {}, LIMIT_MS);
        const isOld = state.age === null || state.age > OLD_S;
        if (!isOld) this.state = state;
        this.problem = isOld ? state.problem || "no answer" : "";
        if (!isOld && !this.choices.adaptors.length) await this.readChoices();
      } catch (error) {
        this.failed(error);
        this.problem = error.message;
      }
      if (!this.isGone) this.timer = setTimeout(() => this.look(), EVERY_MS);
    },
    async readChoices() {
      this.choices = await callPanel("panel_choices", this.robot, {}, LIMIT_MS);
      if (this.program === null && this.choices.loaded) this.program = LOADED;
    },
    // A console that does not know us any more asks for the PIN again.
    failed({ status }) {
      if (status === 401) window.location.reload();
    },
    async act(operation, argument, limitMs) {
      this.isBusy = true;
      this.message = "";
      const isDone = await callPanel(operation, this.robot, argument, limitMs).then(() => true, (error) => {
        this.failed(error);
        this.say(plainWords(error.message));
      });
      this.isBusy = false;
      return Boolean(isDone);
    },
    say(message) {
      this.message = message;
      clearTimeout(this.messageTimer);
      this.messageTimer = setTimeout(() => { this.message = ""; }, MESSAGE_MS);
    },
    order(order) {
      return this.act("panel_order", { order });
    },
    answer(yes) {
      return this.act("panel_answer", { number: this.state.question.number, yes });
    },
    start() {
      return this.act("panel_run", { program: this.program });
    },
    // It can be pressed again while an answer is awaited, and whatever else is under way.
    async stop() {
      this.isStopping = true;
      await callPanel("panel_stop", this.robot, {}, STOP_MS).catch((error) => {
        this.failed(error);
        this.say(`${this.robot} may still move: ${error.message}`);
      });
      this.isStopping = false;
    },
    // An actual robot takes a second touch.
    async choose({ adaptor, model }) {
      if (adaptor === this.state.adaptor) return;
      clearTimeout(this.sureTimer);
      if (model === "actual" && this.sure !== adaptor) {
        this.sure = adaptor;
        this.sureTimer = setTimeout(() => { this.sure = ""; }, 4000);
        return;
      }
      this.sure = "";
      await this.act("panel_switch", { adaptor });
    },
    async chosen(program) {
      this.program = program;
      this.isChoosing = false;
    },
  },
  watch: {
    // Programs may have come, and another one may be loaded.
    isChoosing(isOpen) {
      if (isOpen) this.readChoices().catch((error) => this.say(error.message));
    },
  },
};
