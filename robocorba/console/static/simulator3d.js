// The 3D simulator: floors with walls cut away, from the live system or from a robot's data pool; robots at their joint
// angles with what their display shows, their rays, and the ghost of the selected one at its target.
import { HandSteps } from "/static/arm_poser.js";
import { FloorMesh } from "/static/floor_mesh.js";
import { live } from "/static/live.js";
import { RayFans } from "/static/ray_fans.js";
import { RobotCrowd } from "/static/robot_crowd.js";
import { panelAddress } from "/static/robot_display.js";
import { loadRobotShape } from "/static/robot_model.js";
import { HappeningFeed } from "/static/happening_feed.js";
import PastNote from "/static/past_note.js";
import { RayLegend } from "/static/sensor_views.js";
import { SceneView } from "/static/scene_view.js";
import { rememberView, sharedView } from "/static/shared_view.js";
import { cameraMethods } from "/static/simulator3d_camera.js";
import { pastMethods } from "/static/simulator3d_past.js";
import { poseMethods } from "/static/simulator3d_pose.js";
import { sceneMethods } from "/static/simulator3d_scene.js";
import TimeBar from "/static/time_bar.js";
import ViewTools from "/static/view_tools.js";

const CUT_M = 1.1;
// In the stack heights are drawn larger by this factor.
const STACK_SPREAD = 2.5;
const STACKED = "\u0000stack";

export default {
  components: { HandSteps, PastNote, RayLegend, TimeBar, ViewTools },
  template: `
    <div class="scene-page">
      <div class="console-tabs">
        <div role="tablist" aria-label="Floors" class="scene-floors">
          <button v-for="floor in floors" :key="floor" role="tab" :aria-selected="floor === current" :disable="isPool"
                  :title="floor" @click="show(floor)">
            <bdi>{{ floor }}</bdi> <small v-if="past.isLive">{{ counts[floor] || "" }}</small></button>
          <button v-if="floors.length > 1" role="tab" :aria-selected="isStacked" @click="show(stacked)">
            all floors</button>
        </div>
        <label class="scene-field">scene of
          <select v-model="source" aria-label="Source of the scene"><option value="">the simulation</option>
            <option v-for="name in robots" :key="name" :value="name">{{ name }}'s data pool</option></select></label>
        <label class="scene-field">robot
          <select v-model="selected" aria-label="Robot" @change="find"><option value="">none</option>
            <option v-for="name in robots" :key="name" :value="name">{{ name }}</option></select></label>
        <label class="scene-field">walls
          <input type="range" min="0.1" max="3" step="0.1" v-model.number="cut" aria-label="Height of walls"></label>
      </div>
      <div class="console-scene" :class="{ 'is-past': !past.isLive }" ref="scene">
        <PastNote v-if="!past.isLive" :past="past" :events="events"
                  more="rest postures, since postures are not recorded"
                  @live="$refs.time.goLive()" />
        <div v-if="message" class="console-overlay"><span>{{ message }}</span></div>
        <ViewTools :canvas="() => ({ fit: lookAtAll, zoom })" :tools="tools()" />
        <RayLegend v-if="!selected" :scans="scans" />
        <section v-if="selected" class="scene-facts" aria-label="Selected robot">
          <h2 class="console-heading"><bdi>{{ selected }}</bdi> <a :href="panelAddress(selected)">panel</a></h2>
          <dl class="console-facts"><template v-for="[name, value] in facts" :key="name">
            <dt>{{ name }}</dt><dd>{{ value }}</dd></template></dl>
          <RayLegend :scans="scans" />
          <template v-if="isPosing">
            <div class="console-actions">
              <label>hand <select v-model="side" aria-label="Hand">
                <option>left</option><option>right</option><option>both</option></select></label>
              <q-btn dense flat no-caps size="sm" icon="accessibility_new" label="as it stands" @click="pose" />
            </div>
            <hand-steps :target="() => target"></hand-steps>
            <div class="scene-words" :class="{ 'is-problem': problem }" role="status">{{ problem || words }}</div>
          </template>
        </section>
      </div>
      <TimeBar v-show="!isPool" ref="time" :floor="isStacked ? '' : current" :floors="isPool ? [] : shownFloors"
               :happenings="events" @show="showTime" @look="lookBack" />
    </div>`,
  data() {
    return {
      floors: [], counts: {}, current: "", stacked: STACKED, source: "", robots: [], selected: "", isFollowing: false,
      hasRays: true, hasNames: true, isPosing: false, cut: CUT_M, message: "loading the robot's model", side: "left",
      facts: [], words: "", problem: "", scans: [], past: { isLive: true }, events: [],
    };
  },
  computed: {
    isStacked() { return this.current === STACKED; },
    isPool() { return Boolean(this.source); },
    shownFloors() { return this.isStacked ? this.floors : [this.current].filter(Boolean); },
  },
  async mounted() {
    this.meshes = new Map();
    const wanted = new URLSearchParams(location.search);
    try {
      const shape = await loadRobotShape();
      if (this.isGone) return;
      this.shape = shape;
      this.view = new SceneView(this.$refs.scene, {
        notify: (message) => this.notify(message), key: (event) => this.key(event),
        pointer: (kind, event) => this.pointer(kind, event), moved: () => this.crowd?.update(),
        remade: () => (this.isPosing = false),
      });
    } catch (error) {
      this.message = error.message;
      return;
    }
    this.crowd = new RobotCrowd(this.view, this.shape);
    this.rays = new RayFans(this.view, this.shape);
    this.seen = new Map();
    this.feed = new HappeningFeed((events) => { this.events = events; });
    this.unlisten = live.listen((kind, name) => this.news(kind, name));
    this.timer = setInterval(() => this.second(), 500);
    const [floor, robot, pool] = ["floor", "robot", "pool"].map((name) => wanted.get(name) ?? "");
    // What the address says goes first; a robot of an address without a floor is followed to its floor.
    this.wanted = {
      floor: floor === "all" ? STACKED : floor || sharedView.floor, robot: pool || robot || sharedView.robot, pool,
      isFollowing: Boolean(pool || (robot && !floor)),
    };
    this.news("connection");
    if (!pool) this.$refs.time.restore();
  },
  unmounted() {
    this.isGone = true;
    clearInterval(this.timer);
    this.unlisten?.();
    this.feed?.close();
    live.want(this);
    this.link?.close();
    this.endPose();
    for (const mesh of this.meshes?.values() ?? []) mesh.close();
    this.crowd?.close();
    this.rays?.close();
    this.view?.close();
  },
  methods: {
    panelAddress,
    notify(message) {
      this.graphics = message;
      this.say();
    },
    // What stands in the way of seeing the scene.
    say() {
      if (this.graphics) this.message = this.graphics;
      else if (this.isPool && this.link?.problem) this.message = this.link.problem;
      else if (this.isPool && !this.link?.floor) this.message = `waiting for ${this.source}'s data pool`;
      else if (!this.floors.length) this.message = live.withoutFloors;
      else if (!this.meshes.size) this.message = live.problems.map || "loading the map";
      else this.message = live.isConnected ? "" : "the connection is lost; this is the last that was seen";
    },
    news(kind, name) {
      if (kind === "connection") {
        this.floors = this.past.floors ?? live.names;
        this.showFirst();
        if (this.isStacked) this.want();
      }
      if (kind === "connection" || kind === "plan") this.loadPlans();
      if (kind === "floor" && this.past.isLive && !this.isPool && this.meshes.has(name)) this.update();
      if (kind === "postures" || kind === "state") this.update();
      if (kind === "state") this.updateRobots();
      if (kind === "scans") this.updateRays();
    },
    // Floors that are stacked are drawn apart, so that one sees into each.
    drawn(height) {
      return this.isStacked ? STACK_SPREAD * height : height;
    },
    shown() {
      if (this.isPool) return this.link?.floor ? [this.link.floor.name] : [];
      return this.shownFloors;
    },
    floor(name) {
      if (this.isPool) return this.link.floor;
      return this.past.isLive ? live.floor(name) : this.seen.get(name);
    },
    showFirst() {
      const { floors, wanted } = this;
      if (this.isPool || this.isStacked || floors.includes(this.current) || !floors.length) return;
      this.show(floors.includes(wanted.floor) || wanted.floor === STACKED ? wanted.floor : floors[0]);
    },
    show(floor) {
      this.current = floor;
      if (this.source) this.source = "";
      this.isFollowing = false;
      this.isNew = true;
      this.want();
      this.loadPlans();
    },
    want() {
      const shown = this.shown();
      const floors = this.isPool || !this.past.isLive ? [] : shown;
      const scans = this.hasRays && this.past.isLive ? shown : [];
      live.want(this, { floors, postures: floors, scans, robot: this.selected, missions: true });
    },
    loadPlans() {
      if (!this.view) return;
      const shown = this.shown();
      for (const [name, mesh] of this.meshes) {
        const isSame = mesh.plan === this.plan(name) && mesh.group.position.z === this.drawn(mesh.plan.elevation);
        if (shown.includes(name) && isSame) continue;
        mesh.close();
        this.meshes.delete(name);
      }
      for (const name of shown) {
        const plan = this.plan(name);
        if (!plan || this.meshes.has(name)) continue;
        const mesh = new FloorMesh(plan, this.cut, this.drawn(plan.elevation));
        this.meshes.set(name, mesh);
        this.view.scene.add(mesh.group);
      }
      if (this.isNew && shown.length && this.meshes.size === shown.length) {
        this.isNew = false;
        if (!this.isFollowing) this.look();
      }
      this.say();
      this.update();
    },
    lookAtAll() {
      this.isFollowing = false;
      this.look();
    },
    look() {
      const plans = [...this.meshes.values()].map((mesh) => mesh.plan);
      if (!plans.length) return;
      const of = (most, index) => most(...plans.map((plan) => plan.bounds[index]));
      const heights = plans.map((plan) => this.drawn(plan.elevation));
      const low = [of(Math.min, 0), of(Math.min, 1), Math.min(...heights)];
      const high = [of(Math.max, 2), of(Math.max, 3), Math.max(...heights) + this.cut];
      this.view.fit([low, high], this.isStacked ? [-0.5, -0.9, 0.75] : undefined);
    },
    note() {
      const shown = this.isPool ? { pool: this.source, floor: "", robot: "" }
        : { pool: "", floor: this.isStacked ? "all" : this.current, robot: this.selected };
      // Until the wanted robot and floor are known, they are still those to keep.
      const robot = this.selected || this.wanted?.robot || "";
      const isFloor = this.floors.includes(this.current);
      rememberView({ robot, floor: isFloor ? this.current : sharedView.floor }, shown);
    },
    ...sceneMethods,
    ...cameraMethods,
    ...pastMethods,
    ...poseMethods,
  },
  watch: {
    current() { this.note(); },
    source() {
      this.poolFloor = "";
      this.note();
      if (this.source && !this.past.isLive) this.$refs.time.goLive();
      this.isFollowing = Boolean(this.source) && !this.crowd?.robot(this.source);
      this.isNew = true;
      if (this.source) this.selected = this.source;
      this.connect();
      this.want();
      this.loadPlans();
    },
    selected() {
      this.note();
      this.isPosing = false;
      this.followed = "";
      if (!this.selected) this.isFollowing = false;
      this.connect();
      this.want();
      this.updateFacts();
      this.updateRays();
      this.update();
    },
    isFollowing() {
      this.followed = "";
      this.update();
    },
    cut() {
      for (const mesh of this.meshes.values()) mesh.build(this.cut);
      this.update();
    },
    hasRays() {
      this.want();
      this.updateRays();
    },
    hasNames() { this.update(); },
    isPosing() {
      if (!this.isPosing) {
        this.endPose();
        return;
      }
      this.isFollowing = true;
      this.pose();
    },
    side() {
      if (this.isPosing) this.pose();
    },
  },
};
