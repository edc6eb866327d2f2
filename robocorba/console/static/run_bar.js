// The robot that runs the program, its state, and the orders to it.
import { live } from "/static/live.js";
import { rememberView } from "/static/shared_view.js";

export const RunBar = {
  // robots: [{name, text}]. robot: {name, condition, adaptor, isActual, runs, shown, problem, floor}, shown: on its touch panel;
  // for none name is "".
  // progress: {text, kind: "" | "error" | "done"} of the running or last program.
  props: { robots: Array, robot: Object, canRun: Boolean, why: String, progress: Object },
  emits: ["choose", "run", "step", "pause", "abort", "release", "panel", "dismiss"],
  template: `
    <div class="program-bar run-bar" role="toolbar" aria-label="Run">
      <label class="run-robot"><span>robot</span>
        <select :value="robot.name" aria-label="Robot" @change="$emit('choose', $event.target.value)">
        <option v-if="!robots.length" value="">none</option>
        <option v-for="each in robots" :key="each.name" :value="each.name">{{ each.text }}</option></select></label>
      <span v-if="robot.adaptor" class="run-adaptor" :class="{ 'is-actual': robot.isActual }">
        {{ robot.isActual ? "actual" : "virtual" }} <small>{{ robot.adaptor }}</small></span>
      <q-btn dense no-caps :color="robot.isActual ? 'warning' : 'primary'"
             :text-color="robot.isActual ? 'black' : 'white'" icon="play_arrow"
             :label="robot.isActual ? 'Run on actual' : 'Run'" :disable="!canRun" :title="why" @click="$emit('run')" />
      <q-btn dense no-caps outline icon="skip_next" label="Step" :disable="!canRun && !isPaused"
             :title="why || 'Run to the next icon'" @click="$emit('step')" />
      <q-btn dense no-caps outline :icon="isPaused ? 'play_arrow' : 'pause'" :disable="!isActive"
             :label="isPaused ? 'Resume' : 'Pause'" @click="$emit('pause')" />
      <q-btn dense no-caps outline icon="stop" label="Abort" :disable="!isActive" @click="$emit('abort')" />
      <q-btn dense no-caps outline icon="upload" label="Upload"
             title="To the robot's own computer, which runs it without this one" @click="$emit('panel', 'upload')" />
      <q-btn dense no-caps outline icon="swap_horiz" :label="robot.isActual ? 'Switch to virtual' : 'Switch to actual'"
             title="This computer moves another robot from now on" :disable="!robot.name || isActive"
             @click="$emit('panel', 'switch')" />
      <span class="run-progress" :class="'is-' + (problem ? 'error' : progress.kind)" role="status" aria-live="polite">
        <q-icon v-if="problem || progress.kind === 'error'" name="warning" size="18px" />
        <q-icon v-else-if="progress.kind === 'done'" name="check_circle" size="18px" />
        <span :title="problem || progress.text">{{ problem || progress.text || others }}</span>
        <a v-if="robot.floor && (isActive || progress.text)" :href="monitor" class="run-watch"
           @click="goLive">watch {{ robot.name }}</a>
        <q-btn v-if="robot.condition === 'stopped'" dense no-caps outline label="Release stop"
               @click="$emit('release')" />
        <q-btn v-else-if="progress.text && progress.isOver" flat dense round size="sm" icon="close" aria-label="Dismiss"
               @click="$emit('dismiss')" />
      </span>
    </div>`,
  computed: {
    isPaused() {
      return this.robot.condition === "paused";
    },
    isActive() {
      return this.isPaused || this.robot.condition === "running";
    },
    // The monitor page with the robot selected.
    monitor() {
      return `/?${new URLSearchParams({ floor: this.robot.floor, robot: this.robot.name })}`;
    },
    // What the robot runs that was not started here.
    others() {
      return this.isActive ? `${this.robot.name} runs "${this.robot.runs}", started elsewhere` : "";
    },
    problem() {
      if (!this.robots.length) return live.knowsRobots ? "no robots; start one on the page Monitor, in Processes" : "connecting";
      if (this.robot.problem) return this.robot.problem;
      return this.robot.condition === "stopped" ? `${this.robot.name} ${this.robot.shown}` : "";
    },
  },
  methods: {
    goLive() {
      rememberView({ past: null });
    },
  },
};
