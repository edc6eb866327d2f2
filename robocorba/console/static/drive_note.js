// Drives of one robot by clicks on the map: the way to the places, its length and time, or why there is none; then the
// robot drives there once, or there and back again until it is stopped.
import { attempt, call } from "/static/calls.js";

const PROGRAM = "drive here";
// Repeats of a patrol, the most that a program has.
const ROUNDS = 10000;
// How long the robot may take to end an earlier drive, and pause between attempts [ms].
const END_MS = 5000, AGAIN_MS = 250;

export default {
  // robot: its row. radius: of its body [m]. places: {floor, x, y} in their order.
  props: { robot: Object, radius: Number, places: Array },
  // ways: the points of the way, each with its floor. undo: without the last place. close: it drives, or is not to.
  emits: ["ways", "undo", "close"],
  template: `
    <div class="scene-note drive-note" role="status">
      <span>{{ text }}</span>
      <template v-if="places.length">
        <q-btn dense no-caps color="primary" label="Drive" :disable="!isPossible" @click="drive(false)" />
        <q-btn dense no-caps outline label="Patrol" :disable="!isPossible"
               title="There and back again, until it is stopped" @click="drive(true)" />
        <q-btn dense no-caps outline label="Undo" title="Without the last place" @click="$emit('undo')" />
      </template>
      <q-btn dense flat round icon="close" aria-label="Close" title="Close (Escape)" @click="$emit('close')" />
    </div>`,
  data() {
    return { legs: [], problem: "", isAsking: false };
  },
  computed: {
    isPossible() {
      return !this.isAsking && !this.problem;
    },
    text() {
      const { robot: { name }, places, legs, problem, isAsking } = this;
      if (problem) return `${name}: ${problem}`;
      if (!places.length) return `click where ${name} is to drive; further clicks: to all places in their order`;
      if (isAsking) return `${name}: planning`;
      const metres = total(legs, "length"), seconds = total(legs, "seconds");
      return `${name}: ${metres.toFixed(1)} m, about ${Math.ceil(seconds)} s`;
    },
  },
  watch: {
    places: { handler: "plan", immediate: true },
  },
  methods: {
    async plan() {
      const { robot, places } = this;
      this.problem = "";
      this.show([]);
      this.isAsking = true;
      try {
        const legs = await Promise.all(places.map((goal, index) => this.leg(places[index - 1] ?? robot.at, goal)));
        if (places === this.places) this.show(legs);
      } catch (error) {
        if (places === this.places) this.problem = error.message;
      } finally {
        if (places === this.places) this.isAsking = false;
      }
    },
    async leg({ floor, x, y }, goal) {
      const found = await call("map_paths", { start: { floor, x, y }, goal, radius: this.radius });
      const path = found.find(({ points }) => points);
      if (!path) throw new Error(found[0].reason);
      return path;
    },
    show(legs) {
      this.legs = legs;
      this.$emit("ways", legs.flatMap(({ points }) => points));
    },
    async drive(isPatrol) {
      const { robot: { name, at }, places } = this;
      const goals = isPatrol ? [...places, at] : places;
      const icons = goals.map(({ floor, x, y }) => ({ icon: "mbase_path", floor, x, y }));
      const body = isPatrol ? [{ icon: "repeat", times: ROUNDS, icons }] : icons;
      const program = JSON.stringify({ format: 1, name: PROGRAM, robot: "SmartPal", icons: body });
      await attempt(this, async () => {
        const { findings } = await call("check_program", { robot: name, program });
        const error = findings.find(({ kind }) => kind === "error");
        if (error) throw new Error(error.reason);
        await this.endDrive();
        await call("run_program", { robot: name, program });
        this.$emit("close");
      }, { busy: "isAsking" });
    },
    // A drive that was begun here before ends; another program of the robot does not.
    async endDrive() {
      if (!isDriving(this.robot)) return;
      await call("abort_program", { robot: this.robot.name });
      const deadline = performance.now() + END_MS;
      while (isDriving(this.robot) && performance.now() < deadline) {
        await new Promise((resume) => { setTimeout(resume, AGAIN_MS); });
      }
    },
  },
};

function isDriving({ program, condition }) {
  return program === PROGRAM && condition !== "idle";
}

function total(legs, what) {
  return legs.reduce((sum, leg) => sum + leg[what], 0);
}
