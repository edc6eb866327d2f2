// The monitor page: a live floor beside robots, events, channels and processes, and a timeline to look back.
import { FloorCanvas } from "/static/floor_canvas.js";
import { HappeningFeed } from "/static/happening_feed.js";
import { call, live } from "/static/live.js";
import { lookBack, recordedPlan } from "/static/past.js";
import { displayText } from "/static/robot_display.js";
import { Collisions, ageText, robotRows } from "/static/robot_rows.js";
import { BodyDrag } from "/static/body_drag.js";
import DriveNote from "/static/drive_note.js";
import JogPad from "/static/jog_pad.js";
import { monitorHands } from "/static/monitor_hands.js";
import { MonitorScene } from "/static/monitor_scene.js";
import { rememberView, sharedView } from "/static/shared_view.js";
import ChannelGraph from "/static/channel_graph.js";
import HappeningList from "/static/happening_list.js";
import PastNote from "/static/past_note.js";
import ProcessList from "/static/process_list.js";
import RobotPanel from "/static/robot_panel.js";
import { RayLegend } from "/static/sensor_views.js";
import RobotTable from "/static/robot_table.js";
import SimulationBar from "/static/simulation_bar.js";
import TabList from "/static/tab_list.js";
import TimeBar from "/static/time_bar.js";
import ViewTools from "/static/view_tools.js";

const RIGHTS_MS = 5000;

export default {
  components: {
    ChannelGraph, DriveNote, HappeningList, JogPad, PastNote, ProcessList, RayLegend, RobotPanel, RobotTable, SimulationBar,
    TabList, TimeBar, ViewTools,
  },
  template: `
    <div class="console-split">
      <section class="monitor-main">
        <div class="monitor-bar">
          <TabList label="Floors" :names="shownFloors" :chosen="current" :counts="past.isLive && isKnown ? counts : undefined"
                   @choose="show" />
          <SimulationBar :rights="rights" />
        </div>
        <div class="console-scene" :class="{ 'is-picking': isPicking, 'is-past': !past.isLive }">
          <canvas ref="canvas" tabindex="0" role="application"
                  :aria-label="'Floor ' + current + '; + and - zoom, 0 shows all, arrows move, F follows'"></canvas>
          <div v-if="!hasPlan" class="console-overlay">{{ message }}</div>
          <PastNote v-if="!past.isLive" :past="past" :events="events" @live="$refs.time.goLive()" />
          <DriveNote v-else-if="places && robot" :robots="chosen.filter(({ agent, at }) => agent && at)"
                     :bodies="bodies" :places="places" @ways="scene.drive = $event; canvas.redraw()"
                     @undo="places = places.slice(0, -1)" @close="places = null" />
          <div v-else-if="trouble" class="scene-note is-problem" role="status">{{ trouble }}</div>
          <div v-else-if="hint" class="scene-note" role="status">{{ hint }}</div>
          <RayLegend v-if="past.isLive" :scans="seen" />
          <JogPad v-if="isJogging && mayJog" :key="selected" :robot="robot"
                  :body="() => canvas.floor?.body(selected) ?? robot?.at" />
          <ViewTools :canvas="() => canvas" :tools="tools()" />
        </div>
        <TimeBar ref="time" :floor="current" :floors="[current]" :happenings="events" @show="showTime"
                 @look="lookBack" />
      </section>
      <aside class="console-side" aria-label="Details">
        <TabList label="Details" :names="sides" :chosen="side" @choose="side = $event" />
        <div v-show="side === 'Robots'" class="side-robots">
          <RobotTable :class="{ 'is-now': !past.isLive }" :note="past.isLive ? '' : 'The robots as they are now:'"
                      :robots="robots" :selected="selected" :also="also"
                      :is-connected="isKnown" @select="choose" />
          <RobotPanel v-if="robot" :key="robot.name" class="robot-panel" :robot="robot" :chosen="chosen" :scans="scans"
                      :rights="rights" :floors="floors" :past="past" :then="then"
                      :process="processes[robot.name]" @forgotten="select('')" />
          <p v-else-if="robots.length" class="panel-note">Select a robot here or on the map.</p>
        </div>
        <HappeningList v-if="side === 'Events'" :happenings="events" :is-known="isKnown" @look="lookBack" />
        <ChannelGraph v-if="side === 'Channels'" />
        <ProcessList v-if="side === 'Processes'" :floors="floors" :channels="channels" :rights="rights" :picked="picked"
                     :is-picking="isPicking"
                     @pick="pick" @processes="setProcesses" />
      </aside>
    </div>`,
  data() {
    return {
      floors: [], current: "", counts: {}, robots: [], selected: "", also: [], isFollowing: false, hasPlan: false,
        isKnown: false, message: "connecting",
      sides: ["Robots", "Events", "Channels", "Processes"], side: "Robots", scans: [], seen: [], rights: {}, events: [],
      channels: [], past: { isLive: true }, then: null, trouble: "",
      shown: { scans: true, ways: true, roads: false }, isMoving: false, isPicking: false, isJogging: false,
      // Where the selected robot is to drive, null while the tool is not in use.
      places: null, picked: null, processes: {},
    };
  },
  computed: {
    shownFloors() {
      return this.past.floors ?? this.floors;
    },
    robot() {
      return this.robots.find((each) => each.name === this.selected);
    },
    mayDrive() {
      return Boolean(this.past.isLive && this.robot?.agent && this.robot.at);
    },
    mayJog() {
      const { mayDrive, robot, current } = this; // by sight: only on the floor that is shown
      return mayDrive && robot.floor === current && (robot.condition === "idle" || robot.program === "teleoperation");
    },
    chosen() {
      return this.robots.filter(({ name }) => [this.selected, ...this.also].includes(name));
    },
    hint() {
      if (this.isPicking) return "click a free place; Escape cancels";
      return this.isMoving ? "drag a robot or an object; Q and E turn it, Escape cancels" : "";
    },
  },
  mounted() {
    this.canvas = new FloorCanvas(this.$refs.canvas, { pointer: (...news) => this.pointer(...news) });
    this.scene = new MonitorScene(this.canvas);
    this.collisions = this.scene.collisions = new Collisions();
    this.drag = new BodyDrag(this.scene);
    this.feed = new HappeningFeed((events) => { this.events = events; });
    this.unlisten = live.listen((kind, name) => this.news(kind, name));
    this.onKey = (event) => this.key(event);
    window.addEventListener("keydown", this.onKey);
    this.timer = setInterval(() => this.updateTable(), 1000);
    this.rightsTimer = setInterval(() => this.askRights(), RIGHTS_MS);
    this.askRights();
    this.selected = sharedView.robot;
    this.news("connection");
    this.$refs.time.restore();
  },
  unmounted() {
    this.unlisten();
    this.feed.close();
    live.want(this);
    clearInterval(this.timer);
    clearInterval(this.rightsTimer);
    window.removeEventListener("keydown", this.onKey);
    this.canvas.close();
  },
  watch: {
    selected() {
      this.canvas.selected = this.selected;
      this.places = null;
      this.note();
      this.updateThen();
      this.updateTable();
      this.showLayers();
    },
    also() {
      this.canvas.also = this.also;
      this.canvas.redraw();
    },
    places() {
      if (!this.places) this.scene.drive = [];
      this.canvas.redraw();
    },
    mayDrive() {
      if (!this.mayDrive) this.places = null;
    },
    isMoving() {
      if (this.isMoving) this.places = null;
      else this.drag.cancel();
    },
  },
  methods: {
    news(kind, name) {
      if (kind === "connection") {
        this.floors = live.names;
        if (this.past.isLive && !this.floors.includes(this.current)) this.display(this.firstOf(this.floors));
        if (!this.floors.length) this.message = live.withoutFloors;
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
    // The floor that a user looked at last, if it is among some.
    firstOf(floors) {
      return floors.includes(sharedView.floor) ? sharedView.floor : floors[0] ?? "";
    },
    show(floor) {
      if (floor !== this.current) this.display(floor);
      this.note();
    },
    display(floor) {
      this.current = this.scene.floorName = floor;
      this.scene.scans = [];
      this.drag.cancel();
      this.showLayers();
      this.canvas.floor = floor && this.past.isLive ? live.floor(floor) : null;
      this.showPlan();
    },
    // What is shown is kept for the other pages, and in the address.
    note() {
      rememberView({ floor: this.current || sharedView.floor, robot: this.selected });
    },
    showLayers() {
      const { current, selected, shown } = this;
      this.scene.shown = shown;
      this.canvas.isShownRoadmap = shown.roads;
      live.want(this, current
        ? { floors: [current], scans: shown.scans ? [current] : [], robot: selected, reservations: shown.ways,
          missions: true } : undefined);
      if (!shown.scans) this.scene.scans = [];
      this.canvas.redraw();
    },
    showPlan() {
      const { current, past: { recording } } = this;
      if (!current) this.setPlan(undefined);
      else this.setPlan(recording ? recordedPlan(recording, current, () => this.showPlan()) : live.plan(current));
    },
    setPlan(plan) {
      this.hasPlan = Boolean(plan);
      if (plan) this.canvas.setPlan(plan);
      else if (this.current) this.message = "loading the map";
    },
    // News of the time bar: {isLive} or a floor of the past.
    showTime(news) {
      const wasOther = news.isLive !== this.past.isLive || news.recording !== this.past.recording;
      const { isLive, at, recording } = news;
      this.past = { isLive, at, recording, floors: recording ? news.floors ?? this.past.floors : undefined };
      this.scene.isPast = !news.isLive;
      if (!news.isLive) this.isMoving = false;
      const names = this.shownFloors;
      if (!names.includes(this.current)) this.display(this.firstOf(names));
      else if (wasOther) this.display(this.current);
      const floor = news.seen?.get(this.current);
      if (floor) this.canvas.floor = floor;
      this.updateThen();
      this.followBody();
      this.canvas.redraw();
    },
    // Where the selected robot was at the moment that is shown.
    updateThen() {
      const body = this.past.isLive ? null : this.canvas.floor?.body(this.selected);
      this.then = body ? { ...body, floor: this.current } : null;
    },
    lookBack(happening) {
      lookBack(this, happening);
    },
    updateTable() {
      const { state } = live;
      this.isKnown = live.knowsRobots;
      if (!state) return;
      const wait = (performance.now() - live.stateAt) / 1000;
      const rows = robotRows(state, live.isConnected ? Math.min(wait, 1) : wait);
      this.collisions.update(state.server.state?.state.collisions ?? null, live.floor(this.current),
        live.plan(this.current));
      this.counts = {};
      for (const row of rows) {
        if (row.isHere) this.counts[row.floor] = (this.counts[row.floor] ?? 0) + 1;
        row.news = ageText(row.age);
        row.word = this.collisions.has(row.name) ? "\u2715 collision" : displayText(row.display);
      }
      this.robots = rows;
      this.scene.robots = new Map(rows.map((row) => [row.name, row]));
      this.channels = Object.keys(state.channels);
      this.noteTrouble();
      if (this.isFollowing && this.past.isLive && this.robot?.isHere && this.robot.floor !== this.current
        && this.floors.includes(this.robot.floor)) {
        this.show(this.robot.floor);
      }
      this.takeScans();
      this.canvas.redraw();
    },
    // Since when the shown floor is not up to date, and why.
    noteTrouble() {
      const lost = !live.isConnected ? "the console does not answer" : live.problems.floors || "";
      if (!lost) this.lostAt = undefined;
      else this.lostAt ??= performance.now();
      this.scene.floorAge = lost ? Math.max((performance.now() - this.lostAt) / 1000, 0.1) : 0;
      const isShown = lost && this.hasPlan;
      this.trouble = isShown ? `shown as it was ${ageText(this.scene.floorAge)} ago` : (!lost && live.problems.sensors)
        || "";
    },
    takeScans() {
      this.scene.scans = this.shown.scans ? live.scansOn(this.current) : [];
      this.seen = Object.freeze(this.scene.scans);
      this.scans = this.scene.scans.filter((scan) => scan.robot === this.selected);
    },
    async askRights() {
      this.rights = await call("rights").catch(() => ({}));
      if (this.rights.supervisor) await call("processes").then((rows) => this.setProcesses(rows)).catch(() => {});
    },
    setProcesses(rows) {
      this.processes = Object.fromEntries(rows.filter((row) => row.robot).map((row) => [row.robot, row]));
    },
    ...monitorHands,
  },
};
