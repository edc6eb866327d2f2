// The selected robot: what it does, what its sensors see, how it is reached, and orders to it.
import { plainWords, titleOf } from "/static/icon_looks.js";
import { attempt, call, live } from "/static/live.js";
import { missionTitle } from "/static/mission_words.js";
import { clockText } from "/static/past.js";
import { displayText, panelAddress } from "/static/robot_display.js";
import { ageText, degrees } from "/static/robot_rows.js";
import { isRing, ProximityRing, sensorFact } from "/static/sensor_views.js";
import SureButton from "/static/sure_button.js";

export default {
  components: { ProximityRing, SureButton },
  // chosen: rows of all selected robots; past: as the time bar says it; then: the robot's body there, or null.
  props: {
    robot: Object, chosen: Array, scans: Array, rights: Object, floors: Array, past: Object, then: Object, process: Object,
  },
  emits: ["forgotten"],
  template: `
    <section :aria-label="'Robot ' + robot.name">
      <h2 class="console-heading robot-name" :title="robot.name">{{ robot.name }}
        <a v-if="robot.isHere" :href="'/3d?robot=' + encodeURIComponent(robot.name)" title="Show it in 3D">3D</a>
        <a v-if="robot.agent" :href="panelAddress(robot.name)" title="Its touch panel">panel</a></h2>
      <div class="console-actions">
        <q-btn dense no-caps color="negative" icon="front_hand" :label="'Stop' + all"
               @click="orderAll('stop', chosen)" />
        <q-btn v-if="stopped.length" dense no-caps outline :label="'Release' + (all || ' stop')"
               @click="orderAll('reset_stop', stopped)" />
        <q-btn v-if="robot.isHere" dense no-caps outline label="Teleport" :disable="!rights.administrator"
               :aria-expanded="isPlacing"
               :title="rights.administrator ? 'Put it at a pose' : administratorHint" @click="openPlace" />
        <SureButton v-if="robot.isHere" label="Log off" :question="'Log ' + short + ' off?'"
                    :disable="!rights.administrator"
                    :title="rights.administrator ? 'Log it off the simulation' : administratorHint"
                    @sure="run('evict')" />
        <SureButton v-if="process" label="End" :question="'End ' + short + '?'" title="End its process"
                    @sure="run('end_robot')" />
        <q-btn v-if="!robot.isHere && robot.isLost" dense no-caps outline label="Remove from the list"
               @click="forget" />
      </div>
      <form v-if="isPlacing" class="place-form" @submit.prevent="place">
        <label>floor <select v-model="pose.floor"><option v-for="floor in floors" :key="floor">{{ floor }}</option>
          </select></label>
        <label>x, m <input v-model.number="pose.x" type="number" step="0.05" required></label>
        <label>y, m <input v-model.number="pose.y" type="number" step="0.05" required></label>
        <label>heading, \u00b0 <input v-model.number="pose.degrees" type="number" step="15" required></label>
        <q-btn dense no-caps color="primary" type="submit" label="Teleport" />
      </form>
      <p v-if="error" class="panel-error is-problem" role="alert">{{ error }}</p>
      <template v-if="!past.isLive">
        <h3 class="console-heading">At {{ past.at ? clock(past.at) : "that time" }}</h3>
        <dl class="console-facts">
          <template v-for="[name, value] in factsThen" :key="name"><dt>{{ name }}</dt><dd>{{ value }}</dd></template>
        </dl>
        <h3 class="console-heading">Now</h3>
      </template>
      <dl class="console-facts" :class="{ 'is-now': !past.isLive }">
        <template v-for="[name, value] in facts" :key="name"><dt>{{ name }}</dt><dd>{{ value }}
          <ProximityRing v-if="name === ring?.sensor" :scan="ring" /></dd></template>
      </dl>
    </section>`,
  data() {
    return { error: "", isPlacing: false, pose: { floor: "", x: 0, y: 0, degrees: 0 } };
  },
  computed: {
    facts() {
      return [...stateFacts(this.robot), ...this.scans.map(sensorFact), ...programFacts(this.robot),
        ...reachFacts(this.robot)];
    },
    ring() {
      return this.scans.find(isRing);
    },
    factsThen() {
      if (!this.then) return [["pose", "not on the shown floor"]];
      const { floor, x, y, heading, vx, vy, turn } = this.then;
      return [["pose", poseText({ floor, x, y, heading })], ["speed", speedText(Math.hypot(vx, vy), turn)]];
    },
    short() {
      return [...this.robot.name].slice(0, 16).join("");
    },
    stopped() {
      return this.chosen.filter(({ condition }) => condition === "stopped");
    },
    all() {
      return this.chosen.length > 1 ? ` ${this.chosen.length} robots` : "";
    },
    administratorHint() {
      return "this needs a console with the rights of an administrator";
    },
  },
  methods: {
    clock: clockText,
    panelAddress,
    openPlace() {
      const { floor, x, y, heading } = this.robot.at;
      const round = (value) => Math.round(value * 100) / 100;
      this.pose = { floor, x: round(x), y: round(y), degrees: Math.round((heading * 180) / Math.PI) };
      this.isPlacing = !this.isPlacing;
    },
    async place() {
      const { floor, x, y, degrees: angle } = this.pose;
      const heading = (angle * Math.PI) / 180;
      if (await this.run("place", { body: this.robot.name, floor, x, y, heading })) this.isPlacing = false;
    },
    async orderAll(operation, robots) {
      this.error = (await orderEach(robots, (robot) => call(operation, { robot }))).join("; ");
    },
    async forget() {
      if (await this.run("forget_robot")) this.$emit("forgotten");
    },
    run(operation, argument = { robot: this.robot.name }) {
      return attempt(this, () => call(operation, argument), { problem: "error" });
    },
  },
};

// An order to robots, which none of them waits for; why some did not follow it. order(name) throws an Error. A stop is
// tried on robots that are not seen here, too.
export async function orderEach(robots, order) {
  const ends = await Promise.allSettled(robots.map(async ({ name }) => order(name)));
  return ends.flatMap(({ reason }, at) => (reason ? `${robots[at].name}: ${reason.message}` : []));
}

function poseText({ floor, x, y, heading }) {
  const turned = Math.atan2(Math.sin(heading), Math.cos(heading));
  return `${floor}: ${x.toFixed(2)} m, ${y.toFixed(2)} m, ${degrees(turned)}`;
}

function speedText(speed, turn, most) {
  const limit = most === undefined ? "" : ` of at most ${most.toFixed(2)}`;
  return `${speed.toFixed(2)} m/s${limit}, turning ${degrees(turn)}/s`;
}

function stateFacts({ at, agent, client, condition, display, problem, age, mission, isHere }) {
  const rows = [["state", displayText(display)]];
  if (display.kind) rows.push(["for", ageText(display.seconds + age)]);
  rows.push(["last news", ageText(age)]);
  if (problem) rows.push(["problem", problem]);
  if (at) rows.push([isHere ? "pose" : "last pose", poseText(at)]);
  const moving = agent?.actor.moving;
  // The adaptor of a stopped robot is not read; it stands.
  if (moving && condition === "stopped") rows.push(["speed", speedText(0, 0, agent.speedCap)]);
  else if (moving) rows.push(["speed", speedText(Math.hypot(moving.ahead, moving.left), moving.turn, agent.speedCap)]);
  if (live.missions.has(mission)) rows.push(["mission", missionTitle(live.missions.get(mission))]);
  if (client?.since) rows.push(["logged on", clockText(client.since)]);
  return rows;
}

function programFacts({ agent }) {
  const program = agent?.program;
  if (!program?.name) return [];
  const rows = [["program", program.name]];
  if (program.icon) rows.push(["icon", `${plainWords(program.icon)}: ${titleOf(program.kind)}`]);
  rows.push(["done", `${program.iconsDone} icons in ${program.seconds.toFixed(1)} s`]);
  if (!["NO_RESULT", "FAILED"].includes(program.result)) rows.push(["result", [program.result.toLowerCase(),
    program.reason].filter(Boolean).join(": ")]);
  return rows;
}

function reachFacts({ agent, client }) {
  const rows = [];
  if (client) {
    rows.push(["calls", `${client.callRate.toFixed(0)} per second, ${(client.latency * 1000).toFixed(2)} ms each`]);
    rows.push(["last call", `${ageText(client.silent)} before`], ["sensor server", client.sensor || "none"]);
  }
  if (agent) {
    rows.push(["adaptor", agent.adaptor]);
    if (agent.channel !== undefined) rows.push(["channel", agent.channel || "none"]);
    rows.push(["control cycle", `at most ${(agent.tickJitter * 1000).toFixed(1)} ms late`]);
  }
  return rows;
}
