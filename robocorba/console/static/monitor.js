// The monitor page: a live floor beside the robots, the selected one's state, and channels.
import { FloorCanvas } from "/static/floor_canvas.js";
import { call, live } from "/static/live.js";

// A robot without news for this time is shown as lost [s].
const LOST_S = 3;

export default {
  template: `
    <div class="console-split">
      <section style="display: flex; flex-direction: column; flex: 1; min-width: 0; min-height: 0">
        <div class="console-tabs" role="tablist" aria-label="Floors">
          <button v-for="floor in floors" :key="floor" role="tab" :aria-selected="floor === current" @click="show(floor)">
            {{ floor }} <small>{{ counts[floor] ?? 0 }}</small>
          </button>
        </div>
        <div class="console-scene">
          <canvas ref="canvas" tabindex="0" :aria-label="'Floor ' + current" @keydown="key"></canvas>
          <div v-if="!hasPlan" class="console-overlay">{{ message }}</div>
          <div class="console-tools">
            <q-btn dense round color="primary" icon="fit_screen" aria-label="Show the whole floor" @click="canvas.fit()" />
            <q-btn dense round color="primary" icon="add" aria-label="Enlarge" @click="canvas.zoom(1.4)" />
            <q-btn dense round color="primary" icon="remove" aria-label="Reduce" @click="canvas.zoom(1 / 1.4)" />
            <q-btn dense round :color="isFollowing ? 'accent' : 'primary'" icon="my_location"
                   aria-label="Follow the selected robot" @click="isFollowing = !isFollowing" />
            <q-btn dense round color="primary" icon="route" aria-label="Roads" @click="toggleRoads" />
          </div>
        </div>
      </section>
      <aside class="console-side" aria-label="Robots">
        <table class="console-table">
          <thead><tr><th>Robot</th><th>Floor</th><th>State</th><th>Program</th><th>News</th></tr></thead>
          <tbody>
            <tr v-for="robot in robots" :key="robot.name" tabindex="0" :class="{ 'is-lost': robot.isLost }"
                :aria-selected="robot.name === selected" @click="select(robot.name)" @keydown.enter="select(robot.name)">
              <td :title="robot.name">{{ robot.name }}</td><td>{{ robot.floor }}</td><td>{{ robot.condition }}</td>
              <td :title="robot.program">{{ robot.program }}</td><td>{{ robot.news }}</td>
            </tr>
            <tr v-if="!robots.length"><td colspan="5">no robots; start one with: robocorba robot NAME</td></tr>
          </tbody>
        </table>
        <template v-if="detail">
          <h2 class="console-heading">{{ detail.name }}</h2>
          <div class="console-actions">
            <q-btn dense no-caps color="negative" label="Stop" @click="order('stop')" />
            <q-btn dense no-caps outline label="Release stop" @click="order('reset_stop')" />
          </div>
          <dl class="console-facts">
            <template v-for="[name, value] in detail.facts" :key="name"><dt>{{ name }}</dt><dd>{{ value }}</dd></template>
          </dl>
        </template>
      </aside>
    </div>`,
  data() {
    return {
      floors: [], current: "", counts: {}, robots: [], selected: "", isFollowing: false, hasPlan: false,
      message: "connecting", detail: null,
    };
  },
  mounted() {
    this.canvas = new FloorCanvas(this.$refs.canvas, { pointer: (...news) => this.pointer(...news) });
    this.unlisten = live.listen((kind, name) => this.news(kind, name));
    this.recolor = () => this.canvas.redraw();
    window.addEventListener("robocorba-colors", this.recolor);
    this.timer = setInterval(() => this.updateTable(), 500);
    this.news("connection");
  },
  unmounted() {
    this.unlisten();
    live.want(this);
    clearInterval(this.timer);
    window.removeEventListener("robocorba-colors", this.recolor);
    this.canvas.close();
  },
  methods: {
    news(kind, name) {
      if (kind === "connection") {
        this.floors = live.names;
        if (!this.floors.includes(this.current)) this.show(this.floors[0] ?? "");
        if (!this.floors.length) this.message = live.problems.floors || "connecting";
      }
      if (kind === "floor" && name === this.current) {
        if (this.isFollowing && this.selected) {
          const body = live.floor(name).body(this.selected);
          if (body) this.canvas.centreOn(body.x, body.y);
        }
        this.canvas.redraw();
      }
      if (kind === "connection" || kind === "plan") this.showPlan();
      if (kind === "state") this.updateTable();
    },
    show(floor) {
      this.current = floor;
      live.want(this, floor ? { floors: [floor] } : undefined);
      this.canvas.floor = floor ? live.floor(floor) : null;
      this.showPlan();
    },
    showPlan() {
      const plan = this.current ? live.plan(this.current) : undefined;
      this.hasPlan = Boolean(plan);
      if (plan) this.canvas.setPlan(plan);
      else if (this.current) this.message = "loading the map";
    },
    updateTable() {
      const state = live.state;
      if (!state) return;
      const wait = (performance.now() - live.stateAt) / 1000;
      const clients = new Map((state.server.state?.clients ?? []).map((client) => [client.name, client]));
      const names = new Set([...Object.keys(state.robots), ...clients.keys()]);
      this.counts = {};
      this.robots = [...names].sort().map((name) => {
        const agent = state.robots[name]?.state;
        const client = clients.get(name);
        const age = state.robots[name]?.age == null ? null : state.robots[name].age + wait;
        const floor = client?.at.floor ?? agent?.at.floor ?? "";
        const isLost = !client && (age === null || age > LOST_S);
        if (client) this.counts[floor] = (this.counts[floor] ?? 0) + 1;
        return {
          name, floor, isLost, agent, client,
          condition: agent ? agent.condition.toLowerCase() : "",
          program: agent?.program.name ?? "",
          news: age === null ? "" : `${age.toFixed(1)} s`,
        };
      });
      const robot = this.robots.find((each) => each.name === this.selected);
      this.detail = robot ? { name: robot.name, facts: facts(robot) } : null;
    },
    select(name) {
      this.selected = this.canvas.selected = name;
      const robot = this.robots.find((each) => each.name === name);
      if (robot?.floor && robot.floor !== this.current && this.floors.includes(robot.floor)) this.show(robot.floor);
      this.updateTable();
      this.canvas.redraw();
    },
    pointer(kind, event, point) {
      if (kind !== "down") return false;
      const body = this.canvas.bodyAt(point);
      if (body) this.select(body.name);
      return false;
    },
    key(event) {
      const step = 60;
      const moves = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
      if (moves[event.key]) this.canvas.pan(...moves[event.key]);
      else if (event.key === "+") this.canvas.zoom(1.4);
      else if (event.key === "-") this.canvas.zoom(1 / 1.4);
      else if (event.key === "0") this.canvas.fit();
      else return;
      event.preventDefault();
    },
    toggleRoads() {
      this.canvas.isShownRoadmap = !this.canvas.isShownRoadmap;
      this.canvas.redraw();
    },
    async order(operation) {
      try {
        await call(operation, { robot: this.selected });
      } catch (error) {
        this.$q.notify({ type: "negative", message: error.message });
      }
    },
  },
};

function facts({ agent, client }) {
  const rows = [];
  const at = client?.at ?? agent?.at;
  if (at) rows.push(["pose", `${at.floor} ${at.x.toFixed(2)} m, ${at.y.toFixed(2)} m, ${degrees(at.heading)}`]);
  if (agent) {
    rows.push(["adaptor", agent.adaptor], ["condition", agent.condition.toLowerCase()]);
    if (agent.reason) rows.push(["reason", agent.reason]);
    if (agent.program.name) {
      rows.push(["program", agent.program.name], ["icon", `${agent.program.icon} ${agent.program.kind}`]);
      rows.push(["icons done", agent.program.iconsDone], ["running", `${agent.program.seconds.toFixed(1)} s`]);
      if (agent.program.reason) rows.push(["result", agent.program.reason]);
    }
    rows.push(["speed limit", `${agent.speedCap.toFixed(2)} m/s`], ["control cycle", `${(agent.tickJitter * 1000).toFixed(1)} ms late at most`]);
  }
  if (client) {
    rows.push(["calls", `${client.callRate.toFixed(0)} per second, ${(client.latency * 1000).toFixed(2)} ms each`]);
    rows.push(["virtual sensor", client.sensor || "none"], ["last call", `${client.silent.toFixed(2)} s ago`]);
  }
  return rows;
}

function degrees(angle) {
  return `${((angle * 180) / Math.PI).toFixed(0)}\u00b0`;
}
