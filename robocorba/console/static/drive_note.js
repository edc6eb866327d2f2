// Drives of the selected robots by clicks on the map: the ways to the places, their length and time, or why there is
// none; then the robots drive there once, or there and back again until they are stopped. Several robots drive to the
// last place, side by side.
import { call } from "/static/calls.js";
import { drivesTogether } from "/static/drive_together.js";

const PROGRAM = "drive here";
// Repeats of a patrol, the most that a program has.
const ROUNDS = 10000;
// How long a robot may take to end an earlier drive, and pause between attempts [ms].
const END_MS = 5000, AGAIN_MS = 250;

export default {
  // robots: rows of those that are to drive. bodies(): those on the shown floor. places: {floor, x, y} in their order.
  props: { robots: Array, bodies: Function, places: Array },
  // ways: of each robot the points, each with its floor. undo: without the last place. close: they drive, or are not to.
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
    return { drives: [], isAsking: false };
  },
  computed: {
    names() {
      return this.robots.map(({ name }) => name).join(", ");
    },
    possible() {
      return this.drives.filter(({ problem }) => !problem);
    },
    isPossible() {
      return !this.isAsking && this.possible.length > 0;
    },
    text() {
      const { names, robots, places, drives, isAsking } = this;
      if (!places.length && robots.length > 1) return `click where ${names} are to drive, side by side`;
      if (!places.length) return `click where ${names} is to drive; further clicks: to all places in their order`;
      return isAsking ? `${names}: planning` : drives.map(driveText).join("; ");
    },
  },
  watch: {
    places: { handler: "plan", immediate: true },
    names: "plan",
  },
  methods: {
    async plan() {
      const { robots, places, names } = this;
      this.show([]);
      if (!places.length) return;
      this.isAsking = true;
      const drives = robots.length > 1 ? await drivesTogether(robots, places.at(-1), this.bodies(), this.legs)
        : [await this.legs(robots[0], places).then((legs) => ({ robot: robots[0], goals: places, legs, problem: "" }),
          ({ message }) => ({ robot: robots[0], goals: places, legs: [], problem: message }))];
      if (places !== this.places || names !== this.names) return;
      this.isAsking = false;
      this.show(drives);
    },
    legs({ name, at }, goals) {
      const radius = this.bodies().find((body) => body.name === name)?.radius;
      return Promise.all(goals.map(async (goal, index) => {
        const { floor, x, y } = goals[index - 1] ?? at;
        const found = await call("map_paths", { start: { floor, x, y }, goal, radius });
        const path = found.find(({ points }) => points);
        if (!path) throw new Error(found[0].reason);
        return path;
      }));
    },
    show(drives) {
      this.drives = drives;
      this.$emit("ways", drives.map(({ legs }) => legs.flatMap(({ points }) => points)));
    },
    async drive(isPatrol) {
      this.isAsking = true;
      await Promise.all(this.possible.map((each) => this.begin(each, isPatrol).catch((error) => {
        each.problem = error.message;
      })));
      this.isAsking = false;
      this.show(this.drives.filter(({ problem }) => problem));
      if (!this.drives.length) this.$emit("close");
    },
    async begin({ robot: { name, at }, goals }, isPatrol) {
      const icons = [...goals, ...(isPatrol ? [at] : [])].map(({ floor, x, y }) => ({ icon: "mbase_path", floor, x, y }));
      const body = isPatrol ? [{ icon: "repeat", times: ROUNDS, icons }] : icons;
      const program = JSON.stringify({ format: 1, name: PROGRAM, robot: "SmartPal", icons: body });
      const { findings } = await call("check_program", { robot: name, program });
      const error = findings.find(({ kind }) => kind === "error");
      if (error) throw new Error(error.reason);
      await this.endDrive(name);
      await call("run_program", { robot: name, program });
    },
    // A drive that was begun here before ends; another program of the robot does not.
    async endDrive(name) {
      const isOn = () => isDriving(this.robots.find((robot) => robot.name === name) ?? {});
      if (!isOn()) return;
      await call("abort_program", { robot: name });
      const deadline = performance.now() + END_MS;
      while (isOn() && performance.now() < deadline) {
        await new Promise((resume) => { setTimeout(resume, AGAIN_MS); });
      }
    },
  },
};

function driveText({ robot: { name }, legs, problem }) {
  return `${name}: ${problem || `${total(legs, "length").toFixed(1)} m, about ${Math.ceil(total(legs, "seconds"))} s`}`;
}

function isDriving({ program, condition }) {
  return program === PROGRAM && condition !== "idle";
}

function total(legs, what) {
  return legs.reduce((sum, leg) => sum + leg[what], 0);
}
