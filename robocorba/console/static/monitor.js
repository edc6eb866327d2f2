// The monitor page: a live floor beside robots, events, channels and processes, and a timeline to look back.
import { FloorCanvas } from "/static/floor_canvas.js";
import { call, live } from "/static/live.js";
import { Collisions, ageText, robotRows } from "/static/robot_rows.js";
import { BodyDrag } from "/static/body_drag.js";
import { MonitorScene } from "/static/monitor_scene.js";
import ChannelGraph from "/static/channel_graph.js";
import HappeningList from "/static/happening_list.js";
import ProcessList from "/static/process_list.js";
import RobotPanel from "/static/robot_panel.js";
import SimulationBar from "/static/simulation_bar.js";
import TimeBar from "/static/time_bar.js";

const PAN_PX = 60;
// Look back so long before an event [s].
const BEFORE_S = 3;
const RIGHTS_MS = 5000;

export default {
  components: { ChannelGraph, HappeningList, ProcessList, RobotPanel, SimulationBar, TimeBar },
  template: `
    <div class="console-split">
      <section class="monitor-main">
        <div class="monitor-bar">
          <div class="console-tabs" role="tablist" aria-label="Floors" @keydown="tabKey($event, shownFloors, current, show)">
            <button v-for="floor in shownFloors" :key="floor" role="tab" :aria-selected="floor === current" :title="floor"
                    :tabindex="floor === current ? 0 : -1" @click="show(floor)">
              <bdi>{{ floor }}</bdi> <small :title="(counts[floor] ?? 0) + ' robots'">{{ counts[floor] ?? 0 }}</small>
            </button>
          </div>
          <SimulationBar :rights="rights" />
        </div>
        <div class="console-scene" :class="{ 'is-picking': isPicking, 'is-past': !past.isLive }">
          <canvas ref="canvas" tabindex="0" role="application"
                  :aria-label="'Floor ' + current + ': + and - enlarge and reduce, 0 shows all, arrows move, F follows'"></canvas>
          <div v-if="!hasPlan" class="console-overlay">{{ message }}</div>
          <div v-if="!past.isLive" class="scene-note" role="status">
            <strong>{{ past.recording ? "recording" : "past" }}</strong> {{ pastNote }}
          </div>
          <div v-else-if="trouble" class="scene-note is-problem" role="status">{{ trouble }}</div>
          <div v-else-if="hint" class="scene-note" role="status">{{ hint }}</div>
          <div class="console-tools" role="toolbar" aria-label="View">
            <q-btn dense round color="primary" icon="fit_screen" aria-label="Show the whole floor" title="Whole floor (0)" @click="canvas.fit()" />
            <q-btn dense round color="primary" icon="add" aria-label="Enlarge" title="Enlarge (+)" @click="canvas.zoom(1.4)" />
            <q-btn dense round color="primary" icon="remove" aria-label="Reduce" title="Reduce (-)" @click="canvas.zoom(1 / 1.4)" />
            <q-btn dense round v-for="tool in tools" :key="tool.name" :color="tool.isOn ? 'accent' : 'primary'" :icon="tool.icon"
                   :aria-label="tool.title" :aria-pressed="tool.isOn" :title="tool.title" :disable="tool.disable" @click="tool.press" />
          </div>
        </div>
        <TimeBar ref="time" :floor="current" :happenings="happenings" @show="showTime" />
      </section>
      <aside class="console-side" aria-label="Details">
        <div class="console-tabs" role="tablist" aria-label="Details" @keydown="tabKey($event, sides, side, (name) => side = name)">
          <button v-for="name in sides" :key="name" role="tab" :aria-selected="name === side" :tabindex="name === side ? 0 : -1"
                  @click="side = name">{{ name }}</button>
        </div>
        <div v-show="side === 'Robots'" class="side-robots">
          <div class="robot-table">
            <table class="console-table">
              <thead><tr><th>Robot</th><th>Floor</th><th>State</th><th>Program</th><th>News</th></tr></thead>
              <tbody>
                <tr v-for="(robot, index) in robots" :key="robot.name" :data-row="index" tabindex="0" :class="{ 'is-lost': robot.isLost }"
                    :aria-selected="robot.name === selected" @click="select(robot.name)" @keydown="rowKey($event, index)">
                  <td :title="robot.name">{{ robot.name }}</td><td :title="robot.floor">{{ robot.floor }}</td><td :title="robot.problem">{{ robot.word }}</td>
                  <td :title="robot.program">{{ robot.program }}</td><td>{{ robot.news }}</td>
                </tr>
                <tr v-if="!robots.length"><td colspan="5">{{ message === "connecting" ? "connecting" : "no robots; start one in Processes" }}</td></tr>
              </tbody>
            </table>
          </div>
          <RobotPanel v-if="robot" class="robot-panel" :robot="robot" :scans="scans" :rights="rights" :floors="floors" :is-past="!past.isLive"
                      :process="processes[robot.name]" @forgotten="select('')" />
          <p v-else-if="robots.length" class="panel-note">Select a robot here or on the map.</p>
        </div>
        <HappeningList v-if="side === 'Events'" :happenings="happenings" @look="lookBack" />
        <ChannelGraph v-if="side === 'Channels'" />
        <ProcessList v-if="side === 'Processes'" :floors="floors" :channels="channels" :rights="rights" :picked="picked"
                     @pick="pick" @processes="setProcesses" />
      </aside>
    </div>`,
  data() {
    return {
      floors: [], current: "", counts: {}, robots: [], selected: "", isFollowing: false, hasPlan: false, message: "connecting",
      sides: ["Robots", "Events", "Channels", "Processes"], side: "Robots", scans: [], rights: {}, happenings: [], channels: [],
      past: { isLive: true }, trouble: "", shown: { scans: true, ways: true, roads: false }, isMoving: false, isPicking: false,
      picked: null, processes: {},
    };
  },
  computed: {
    shownFloors() {
      return this.past.floors ?? this.floors;
    },
    robot() {
      return this.robots.find((each) => each.name === this.selected);
    },
    hint() {
      if (this.isPicking) return "click a free place; Escape cancels";
      return this.isMoving ? "drag a robot or an object; Q and E turn it, Escape cancels" : "";
    },
    pastNote() {
      if (!this.past.at) return "";
      const at = new Date(this.past.at * 1000).toLocaleTimeString(undefined, { hourCycle: "h23" });
      const last = this.past.recording ? undefined
        : this.happenings.filter((each) => each.at <= this.past.at && each.at > this.past.at - BEFORE_S).pop();
      return last ? `${at}: ${last.text}` : at;
    },
    tools() {
      const toggle = (name, icon, title) => ({
        name, icon, title, isOn: this.shown[name], press: () => { this.shown[name] = !this.shown[name]; this.showLayers(); },
      });
      return [
        { name: "follow", icon: "my_location", title: "Follow the selected robot (F)", isOn: this.isFollowing, press: () => this.follow() },
        toggle("scans", "sensors", "Lasers and proximity"),
        toggle("ways", "route", "Planned ways and reserved areas"),
        toggle("roads", "hub", "Nodes and edges"),
        {
          name: "move", icon: "open_with", isOn: this.isMoving, disable: !this.rights.administrator || !this.past.isLive,
          title: this.rights.administrator ? "Drag robots and objects" : "Dragging needs --administrator FILE",
          press: () => { this.isMoving = !this.isMoving; },
        },
      ];
    },
  },
  mounted() {
    this.canvas = new FloorCanvas(this.$refs.canvas, { pointer: (...news) => this.pointer(...news) });
    this.scene = new MonitorScene(this.canvas);
    this.collisions = this.scene.collisions = new Collisions();
    this.drag = new BodyDrag(this.scene);
    this.unlisten = live.listen((kind, name) => this.news(kind, name));
    this.recolor = () => this.canvas.redraw();
    this.onKey = (event) => this.key(event);
    window.addEventListener("robocorba-colors", this.recolor);
    window.addEventListener("keydown", this.onKey);
    this.timer = setInterval(() => this.updateTable(), 1000);
    this.rightsTimer = setInterval(() => this.askRights(), RIGHTS_MS);
    this.askRights();
    this.news("connection");
  },
  unmounted() {
    this.unlisten();
    live.want(this);
    clearInterval(this.timer);
    clearInterval(this.rightsTimer);
    window.removeEventListener("robocorba-colors", this.recolor);
    window.removeEventListener("keydown", this.onKey);
    this.canvas.close();
  },
  watch: {
    selected() {
      this.canvas.selected = this.selected;
      this.updateTable();
      this.canvas.redraw();
    },
    isMoving() {
      if (!this.isMoving) this.drag.cancel();
    },
  },
  methods: {
    news(kind, name) {
      if (kind === "connection") {
        this.floors = live.names;
        if (this.past.isLive && !this.floors.includes(this.current)) this.show(this.floors[0] ?? "");
        if (!this.floors.length) this.message = live.problems.floors || "connecting";
      }
      if (kind === "floor" && name === this.current && this.past.isLive) {
        this.followBody();
        this.canvas.redraw();
      }
      if (kind === "scans" && name === this.current) this.takeScans();
      if (kind === "reservations") this.scene.reservations = live.reservations;
      if (kind === "scans" || kind === "reservations") this.canvas.redraw();
      if (kind === "connection" || kind === "plan") this.showPlan();
      if (kind === "state" || kind === "connection") this.updateTable();
    },
    show(floor) {
      this.current = this.scene.floorName = floor;
      this.scene.scans = [];
      this.drag.cancel();
      this.showLayers();
      if (this.past.isLive) this.canvas.floor = floor ? live.floor(floor) : null;
      this.showPlan();
    },
    showLayers() {
      const { current, shown } = this;
      this.scene.shown = shown;
      this.canvas.isShownRoadmap = shown.roads;
      live.want(this, current
        ? { floors: [current], scans: shown.scans ? [current] : [], reservations: shown.ways, missions: true } : undefined);
      if (!shown.scans) this.scene.scans = [];
      this.canvas.redraw();
    },
    async showPlan() {
      const { current, past } = this;
      if (past.recording) {
        const plan = await this.recordedPlan(past.recording, current);
        if (current !== this.current || past.recording !== this.past.recording) return;
        this.setPlan(plan);
      } else this.setPlan(current ? live.plan(current) : undefined);
    },
    setPlan(plan) {
      this.hasPlan = Boolean(plan);
      if (plan) this.canvas.setPlan(plan);
      else if (this.current) this.message = "loading the map";
    },
    async recordedPlan(recording, floor) {
      this.recordedPlans ??= new Map();
      const key = `${recording}\n${floor}`;
      if (!this.recordedPlans.has(key)) {
        const answer = await fetch(`/plan?${new URLSearchParams({ floor, recording })}`).catch(() => null);
        if (answer?.ok) this.recordedPlans.set(key, await answer.json());
      }
      return this.recordedPlans.get(key);
    },
    // News of the time bar: {isLive} or a floor of the past.
    showTime(news) {
      const wasOther = news.isLive !== this.past.isLive || news.recording !== this.past.recording;
      this.past = { ...news, floors: news.isLive || !news.recording ? undefined : news.floors ?? this.past.floors };
      this.scene.isPast = !news.isLive;
      if (!news.isLive) this.isMoving = false;
      const names = this.shownFloors;
      if (!names.includes(this.current)) this.show(names[0] ?? "");
      else if (wasOther) this.show(this.current);
      if (news.floor && news.floor.name === this.current) this.canvas.floor = news.floor;
      this.followBody();
      this.canvas.redraw();
    },
    lookBack(happening) {
      if (this.floors.includes(happening.floor)) this.show(happening.floor);
      if (happening.robot) this.selected = happening.robot;
      this.$refs.time.recording = "";
      this.$nextTick(() => this.$refs.time.seek(happening.at - BEFORE_S));
    },
    updateTable() {
      const { state } = live;
      if (!state) return;
      const wait = (performance.now() - live.stateAt) / 1000;
      const rows = robotRows(state, live.isConnected ? Math.min(wait, 1) : wait);
      this.counts = {};
      for (const row of rows) {
        if (row.isHere) this.counts[row.floor] = (this.counts[row.floor] ?? 0) + 1;
        row.news = ageText(row.age);
      }
      this.collisions.update(state.server.state?.state.collisions ?? null, live.floor(this.current), live.plan(this.current));
      for (const row of rows) row.word = this.collisions.has(row.name) ? "\u2715 collision" : row.condition;
      this.robots = rows;
      this.scene.robots = new Map(rows.map((row) => [row.name, row]));
      this.channels = Object.keys(state.channels);
      this.noteTrouble();
      if (this.isFollowing && this.past.isLive && this.robot?.isHere && this.robot.floor !== this.current && this.floors.includes(this.robot.floor)) {
        this.show(this.robot.floor);
      }
      if (state.happenings > (this.happenings.at(-1)?.number ?? 0)) this.loadHappenings();
      this.takeScans();
      this.canvas.redraw();
    },
    // Since when the shown floor is not up to date, and why.
    noteTrouble() {
      const lost = !live.isConnected ? "the console does not answer" : live.problems.floors || "";
      if (!lost) this.lostAt = undefined;
      else this.lostAt ??= performance.now();
      this.scene.floorAge = lost ? Math.max((performance.now() - this.lostAt) / 1000, 0.1) : 0;
      this.trouble = lost ? `${lost}; shown as it was ${ageText(this.scene.floorAge)} ago` : live.problems.sensors ?? "";
    },
    takeScans() {
      this.scene.scans = this.shown.scans ? live.scansOn(this.current) : [];
      this.scans = this.scene.scans.filter((scan) => scan.robot === this.selected);
    },
    async loadHappenings() {
      if (this.isAsking) return;
      this.isAsking = true;
      try {
        const news = await call("happenings", { after: this.happenings.at(-1)?.number ?? 0 });
        this.happenings = [...this.happenings, ...news].slice(-2000);
      } catch {
        // the connection is lost, which the header says; asked again with the next news
      } finally {
        this.isAsking = false;
      }
    },
    async askRights() {
      try {
        this.rights = await call("rights");
      } catch {
        this.rights = {};
      }
      if (!this.rights.supervisor) return;
      await call("processes").then((rows) => this.setProcesses(rows)).catch(() => {});
    },
    setProcesses(rows) {
      this.processes = Object.fromEntries(rows.filter((row) => row.robot).map((row) => [row.robot, row]));
    },
    select(name) {
      this.selected = name;
      const robot = this.robots.find((each) => each.name === name);
      if (this.past.isLive && robot?.floor && robot.floor !== this.current && this.floors.includes(robot.floor)) this.show(robot.floor);
    },
    follow() {
      this.isFollowing = !this.isFollowing;
      this.followBody();
    },
    followBody() {
      if (!this.isFollowing || !this.selected) return;
      const body = this.canvas.floor?.body(this.selected);
      if (body) this.canvas.centreOn(body.x, body.y);
    },
    pick(isPicking) {
      this.isPicking = isPicking;
      if (!isPicking) this.picked = null;
    },
    pointer(kind, event, point) {
      if (this.drag.isActive) return this.drag.pointer(kind, point);
      if (kind !== "down") return false;
      if (this.isPicking) {
        this.picked = { floor: this.current, x: point[0], y: point[1] };
        this.isPicking = false;
        return true;
      }
      const body = this.canvas.bodyAt(point) ?? this.scene.lostAt(point);
      if (!body) return false;
      if (body.kind !== "object") this.select(body.name);
      return this.isMoving && this.past.isLive && body.number !== undefined && this.drag.begin(body, point, this.current);
    },
    key(event) {
      const { target } = event;
      if (event.ctrlKey || event.metaKey || event.altKey || target.closest("input, select, textarea, [contenteditable]")) return;
      const moves = { ArrowLeft: [PAN_PX, 0], ArrowRight: [-PAN_PX, 0], ArrowUp: [0, PAN_PX], ArrowDown: [0, -PAN_PX] };
      if (event.key === "Escape") this.escape();
      else if (this.drag.isActive && "qeQE".includes(event.key)) this.drag.turn(event.key.toLowerCase() === "q" ? 1 : -1);
      else if (moves[event.key] && (target === this.$refs.canvas || target === document.body)) this.canvas.pan(...moves[event.key]);
      else if (event.key === "+" || event.key === "=") this.canvas.zoom(1.4);
      else if (event.key === "-") this.canvas.zoom(1 / 1.4);
      else if (event.key === "0") this.canvas.fit();
      else if (event.key === "f" || event.key === "F") this.follow();
      else return;
      event.preventDefault();
    },
    // Ends one thing: a drag, picking, the tool, following, the selection.
    escape() {
      if (this.drag.isActive) this.drag.cancel();
      else if (this.isPicking) this.pick(false);
      else if (this.isMoving) this.isMoving = false;
      else if (this.isFollowing) this.isFollowing = false;
      else this.selected = "";
    },
    rowKey(event, index) {
      if (event.key === "Enter" || event.key === " ") this.select(this.robots[index].name);
      else if (event.key === "ArrowDown" || event.key === "ArrowUp") {
        const row = event.currentTarget.parentElement.querySelector(`[data-row="${index + (event.key === "ArrowDown" ? 1 : -1)}"]`);
        row?.focus();
        if (row) this.select(this.robots[Number(row.dataset.row)].name);
      } else return;
      event.preventDefault();
      event.stopPropagation();
    },
    // Arrow keys choose the next or the previous tab.
    tabKey(event, names, current, choose) {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step || !names.length) return;
      const next = (names.indexOf(current) + step + names.length) % names.length;
      choose(names[next]);
      event.currentTarget.querySelectorAll("[role=tab]")[next]?.focus();
      event.preventDefault();
      event.stopPropagation();
    },
  },
};
