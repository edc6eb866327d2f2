// The 3D simulator: floors with walls cut away, from the live system or from a robot's data pool; robots at their joint
// angles with what their display shows, their rays, and the ghost of the selected one at its target.
import { THREE } from "nicegui-scene";
import { HandSteps, inWords, stepByKey } from "/static/arm_poser.js";
import { FloorMesh } from "/static/floor_mesh.js";
import { HandTarget } from "/static/hand_target.js";
import { live } from "/static/live.js";
import { RayFans } from "/static/ray_fans.js";
import { RobotCrowd } from "/static/robot_crowd.js";
import { RobotLink } from "/static/robot_link.js";
import { ArticulatedRobot, loadRobotShape } from "/static/robot_model.js";
import { SceneView } from "/static/scene_view.js";

const CUT_M = 1.1;
// A click is not a drag up to this distance [px].
const CLICK_PX = 5;
// A robot without news for this time is lost [s].
const LOST_S = 3;
// In the stack heights are drawn larger by this factor.
const STACK_SPREAD = 2.5;
const STACKED = "\u0000stack";

export default {
  components: { HandSteps },
  template: `
    <div class="scene-page">
      <div class="console-tabs">
        <div role="tablist" aria-label="Floors" class="scene-floors">
          <button v-for="floor in floors" :key="floor" role="tab" :aria-selected="floor === current" :disable="isPool"
                  :title="floor" @click="show(floor)"><bdi>{{ floor }}</bdi> <small>{{ counts[floor] || "" }}</small></button>
          <button v-if="floors.length > 1" role="tab" :aria-selected="isStacked" @click="show(stacked)">all floors</button>
        </div>
        <label class="scene-field">scene of
          <select v-model="source" aria-label="Source of the scene"><option value="">the simulation</option>
            <option v-for="name in robots" :key="name" :value="name">{{ name }}'s data pool</option></select></label>
        <label class="scene-field">robot
          <select v-model="selected" aria-label="Robot"><option value="">none</option>
            <option v-for="name in robots" :key="name" :value="name">{{ name }}</option></select></label>
        <label class="scene-field">walls
          <input type="range" min="0.1" max="3" step="0.1" v-model.number="cut" aria-label="Height of walls"></label>
      </div>
      <div class="console-scene" ref="scene">
        <div v-if="message" class="console-overlay"><span>{{ message }}</span></div>
        <div class="console-tools">
          <q-btn dense round color="primary" icon="fit_screen" aria-label="Show everything" title="show everything (0)" @click="lookAtAll" />
          <q-btn dense round color="primary" icon="add" aria-label="Enlarge" @click="view.turn(0, 0, 0.8)" />
          <q-btn dense round color="primary" icon="remove" aria-label="Reduce" @click="view.turn(0, 0, 1.25)" />
          <q-btn dense round :color="isFollowing ? 'accent' : 'primary'" icon="my_location" :disable="!selected" :aria-pressed="isFollowing"
                 aria-label="Follow the robot" title="follow the robot" @click="isFollowing = !isFollowing" />
          <q-btn dense round :color="hasRays ? 'accent' : 'primary'" icon="sensors" :aria-pressed="hasRays"
                 aria-label="Rays of the sensors" title="rays of the sensors" @click="hasRays = !hasRays" />
          <q-btn dense round :color="hasNames ? 'accent' : 'primary'" icon="label" :aria-pressed="hasNames"
                 aria-label="Names" title="names" @click="hasNames = !hasNames" />
          <q-btn dense round :color="isPosing ? 'accent' : 'primary'" icon="back_hand" :disable="!selected" :aria-pressed="isPosing"
                 aria-label="Pose a hand" title="pose a hand" @click="isPosing = !isPosing" />
          <q-btn dense round color="primary" icon="download" aria-label="The robot as URDF" title="the robot as URDF" type="a" href="/robot.urdf" />
        </div>
        <section v-if="selected" class="scene-facts" aria-label="Selected robot">
          <h2 class="console-heading"><bdi>{{ selected }}</bdi></h2>
          <dl class="console-facts"><template v-for="[name, value] in facts" :key="name"><dt>{{ name }}</dt><dd>{{ value }}</dd></template></dl>
          <template v-if="isPosing">
            <div class="console-actions">
              <label>hand <select v-model="side" aria-label="Hand"><option>left</option><option>right</option><option>both</option></select></label>
              <q-btn dense flat no-caps size="sm" icon="accessibility_new" label="as it stands" @click="pose" />
            </div>
            <hand-steps :target="() => target"></hand-steps>
            <div class="scene-words" :class="{ 'is-problem': problem }" role="status">{{ problem || words }}</div>
          </template>
        </section>
      </div>
    </div>`,
  data() {
    return {
      floors: [], counts: {}, current: "", stacked: STACKED, source: "", robots: [], selected: "", isFollowing: false,
      hasRays: true, hasNames: true, isPosing: false, cut: CUT_M, message: "loading the robot's model", side: "left",
      facts: [], words: "", problem: "",
    };
  },
  computed: {
    isStacked() { return this.current === STACKED; },
    isPool() { return Boolean(this.source); },
  },
  async mounted() {
    this.meshes = new Map();
    const wanted = new URLSearchParams(location.search);
    try {
      const shape = await loadRobotShape();
      if (this.isGone) return;
      this.shape = shape;
      this.view = new SceneView(this.$refs.scene, {
        told: (message) => this.told(message), key: (event) => this.key(event),
        pointer: (kind, event) => this.pointer(kind, event), moved: () => this.crowd?.update(),
      });
    } catch (error) {
      this.message = error.message;
      return;
    }
    this.crowd = new RobotCrowd(this.view, this.shape);
    this.rays = new RayFans(this.view, this.shape);
    this.unlisten = live.listen((kind, name) => this.news(kind, name));
    this.timer = setInterval(() => this.second(), 500);
    this.wanted = { floor: wanted.get("floor") ?? "", robot: wanted.get("robot") ?? "" };
    this.news("connection");
  },
  unmounted() {
    this.isGone = true;
    clearInterval(this.timer);
    this.unlisten?.();
    live.want(this);
    this.link?.close();
    this.endPose();
    for (const mesh of this.meshes?.values() ?? []) mesh.close();
    this.crowd?.close();
    this.rays?.close();
    this.view?.close();
  },
  methods: {
    told(message) {
      this.graphics = message;
      this.say();
    },
    // What stands in the way of seeing the scene.
    say() {
      if (this.graphics) this.message = this.graphics;
      else if (this.isPool && this.link?.problem) this.message = this.link.problem;
      else if (this.isPool && !this.link?.floor) this.message = `waiting for ${this.source}'s data pool`;
      else if (!this.floors.length) this.message = live.problems.floors || "connecting";
      else if (!this.meshes.size) this.message = live.problems.map || "loading the map";
      else this.message = live.isConnected ? "" : "the connection is lost; this is the last that was seen";
    },
    news(kind, name) {
      if (kind === "connection") {
        this.floors = live.names;
        const first = this.wanted.floor && this.floors.includes(this.wanted.floor) ? this.wanted.floor : this.floors[0];
        if (!this.isStacked && !this.floors.includes(this.current) && first) this.show(first);
        if (this.isStacked) this.want();
      }
      if (kind === "connection" || kind === "plan") this.loadPlans();
      if (kind === "floor" && !this.isPool && this.meshes.has(name)) this.update();
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
      return this.isStacked ? this.floors : [this.current].filter(Boolean);
    },
    floor(name) {
      return this.isPool ? this.link.floor : live.floor(name);
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
      const floors = this.shown();
      live.want(this, { floors: this.isPool ? [] : floors, postures: this.isPool ? [] : floors, scans: this.hasRays ? floors : [] });
    },
    loadPlans() {
      if (!this.view) return;
      const shown = this.shown();
      for (const [name, mesh] of this.meshes) {
        if (shown.includes(name) && mesh.plan === live.plan(name) && mesh.group.position.z === this.drawn(mesh.plan.elevation)) continue;
        mesh.close();
        this.meshes.delete(name);
      }
      for (const name of shown) {
        const plan = live.plan(name);
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
    // ---- what is in the scene ----
    update() {
      if (!this.crowd) return;
      const robots = [];
      for (const [name, mesh] of this.meshes) {
        const floor = this.floor(name);
        if (!floor) continue;
        const bodies = [...floor.bodies.values()];
        mesh.setElevators(floor.elevators);
        const here = bodies.filter((body) => body.kind === "robot").map((body) => this.robotOf(body, mesh.plan, floor));
        robots.push(...here);
        mesh.setObjects(bodies.filter((body) => body.kind === "object"), this.hands(here));
      }
      this.crowd.hasNames = this.hasNames;
      this.crowd.set(robots, this.selected);
      this.updateGhost();
      this.follow();
      if (this.target) this.placePose();
    },
    robotOf(body, plan, floor) {
      const row = live.state?.robots[body.name];
      const agent = row?.state;
      return {
        name: body.name, x: body.x, y: body.y, z: this.drawn(heightOf(body, plan, floor)), heading: body.heading, radius: body.radius,
        speed: Math.hypot(body.vx, body.vy), floor: plan.name, joints: this.joints(body.name), ...displayed(agent),
        isLost: Boolean(row) && row.age !== null && row.age > LOST_S,
      };
    },
    joints(robot) {
      return (this.isPool && this.link?.joints.get(robot)) || live.joints(robot);
    },
    // Where hands are that may hold something: those of articulated robots.
    hands(robots) {
      const found = [];
      for (const robot of robots) {
        const model = this.crowd.articulated.get(robot.name);
        if (!model) continue;
        for (const side of ["left", "right"]) {
          const at = model.group.localToWorld(model.mount(`${side}_hand`).position);
          found.push({ x: at.x, y: at.y, z: at.z - robot.z });
        }
      }
      return found;
    },
    updateRobots() {
      const names = Object.keys(live.state.robots).sort();
      if (names.join("\n") !== this.robots.join("\n")) this.robots = names;
      this.counts = {};
      for (const client of live.state.server.state?.clients ?? []) {
        this.counts[client.at.floor] = (this.counts[client.at.floor] ?? 0) + 1;
      }
      if (this.wanted.robot && names.includes(this.wanted.robot)) {
        this.selected = this.wanted.robot;
        this.wanted.robot = "";
        this.isFollowing = true;
      }
      this.updateFacts();
    },
    updateFacts() {
      const agent = live.state?.robots[this.selected]?.state;
      const robot = this.crowd?.robot(this.selected);
      const rows = [];
      if (agent) {
        const { display, words } = displayed(agent);
        rows.push(["display", words ? `${display}: ${words}` : display]);
        rows.push(["at", `${agent.at.floor} ${agent.at.x.toFixed(2)}, ${agent.at.y.toFixed(2)} m`]);
        if (agent.reason) rows.push(["reason", agent.reason]);
      } else {
        rows.push(["", "no news of it"]);
      }
      if (robot) rows.push(["speed", `${robot.speed.toFixed(2)} m/s`]);
      if (this.isPool && this.link?.pool) rows.push(["data pool", `${(1000 * this.link.pool.lag).toFixed(0)} ms old`]);
      if (this.link?.path.length) rows.push(["path", `${this.link.path.length} points`]);
      this.facts = rows;
    },
    updateRays() {
      if (!this.rays) return;
      const scans = [];
      for (const [name, mesh] of this.hasRays ? this.meshes : []) {
        for (const scan of live.scansOn(name)) scans.push({ ...scan, z: mesh.group.position.z });
      }
      // Those of the selected robot first, since the number of rays is limited.
      scans.sort((one, other) => (other.robot === this.selected) - (one.robot === this.selected));
      this.rays.set(scans);
    },
    updateGhost() {
      const path = [];
      let heading = 0;
      for (const point of this.link && this.link.robot === this.selected ? this.link.path : []) {
        const mesh = this.meshes.get(point.floor);
        if (!mesh) continue;
        path.push({ x: point.x, y: point.y, z: mesh.group.position.z });
        heading = point.heading;
      }
      const robot = this.crowd.robot(this.selected);
      const end = path[path.length - 1];
      const isThere = !robot || (end && Math.hypot(end.x - robot.x, end.y - robot.y) < 0.05);
      const key = isThere ? "" : JSON.stringify([path, robot?.joints]);
      if (key === this.ghostKey) return;
      this.ghostKey = key;
      this.crowd.setGhost(isThere ? null : path, heading, robot?.joints);
    },
    // The connection for the path of the selected robot, and for the data pool that is shown.
    connect() {
      const robot = this.source || this.selected;
      if (this.link && this.link.robot === robot && this.link.withPool === this.isPool) return;
      this.link?.close();
      this.link = robot ? new RobotLink(robot, this.isPool, () => this.linkNews()) : null;
    },
    linkNews() {
      if (this.isGone) return;
      const floor = this.isPool ? this.link?.floor?.name : "";
      if (this.isPool && floor !== this.poolFloor) {
        this.poolFloor = floor;
        this.isNew = true;
        this.current = floor ?? "";
        this.want();
        this.loadPlans();
      }
      this.say();
      this.update();
    },
    // ---- the camera ----
    second() {
      this.say();
      this.updateFacts();
      this.crowd?.update();
    },
    follow() {
      const robot = this.crowd.robot(this.selected);
      if (!this.isFollowing) return;
      if (!robot) {
        this.findFloor();
        return;
      }
      const { camera, orbit } = this.view;
      const moved = new THREE.Vector3(robot.x, robot.y, robot.z + 0.75).sub(orbit.target);
      if (this.followed !== robot.name) {
        const bearing = robot.heading - 0.55;
        camera.position.set(robot.x + 2.7 * Math.cos(bearing), robot.y + 2.7 * Math.sin(bearing), robot.z + 1.75);
        this.followed = robot.name;
      } else if (moved.length() > 1e-4) {
        camera.position.add(moved);
      } else {
        return;
      }
      orbit.target.add(moved);
      orbit.update();
      this.view.redraw();
    },
    // The followed robot is on another floor: it has taken an elevator.
    findFloor() {
      const floor = live.state?.robots[this.selected]?.state?.at.floor;
      if (!floor || this.isPool || floor === this.current || !this.floors.includes(floor) || this.isStacked) return;
      this.show(floor);
      this.isNew = false;
      this.isFollowing = true;
    },
    pointer(kind, event) {
      if (kind === "pointerdown") this.pressed = [event.offsetX, event.offsetY];
      else if (this.pressed && Math.hypot(event.offsetX - this.pressed[0], event.offsetY - this.pressed[1]) < CLICK_PX) {
        const robot = this.crowd?.at([event.offsetX, event.offsetY]);
        if (robot) this.selected = robot.name;
      }
    },
    key(event) {
      if (this.target && stepByKey(this.target, event)) return;
      const step = 0.12;
      const turns = {
        ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step],
        "+": [0, 0, 0.85], "-": [0, 0, 1.18],
      };
      if (turns[event.key]) this.view.turn(...turns[event.key]);
      else if (event.key === "0") this.lookAtAll();
      else return;
      event.preventDefault();
    },
    // ---- posing a hand ----
    pose() {
      const robot = this.crowd.robot(this.selected);
      if (!robot) {
        this.isPosing = false;
        return;
      }
      if (!this.target) {
        this.figure = new ArticulatedRobot(this.shape, { isGhost: true });
        this.view.scene.add(this.figure.group);
        this.target = new HandTarget(this.figure, this.view, {
          changed: (result) => (this.words = inWords(result.pose)), told: (problem) => (this.problem = problem),
          redraw: () => this.view.redraw(),
        });
      }
      this.placePose();
      this.target.set(robot.joints?.length ? robot.joints : new Array(18).fill(0), { side: this.side });
      this.words = inWords(this.target.pose);
    },
    placePose() {
      const robot = this.crowd.robot(this.selected);
      if (!robot) return;
      this.figure.group.position.set(robot.x, robot.y, robot.z);
      this.figure.group.rotation.z = robot.heading;
    },
    endPose() {
      this.target?.close();
      this.figure?.close();
      this.target = this.figure = null;
      this.view?.redraw();
    },
  },
  watch: {
    source() {
      this.isFollowing = false;
      this.isNew = true;
      if (this.source) this.selected = this.source;
      this.connect();
      this.want();
      this.loadPlans();
    },
    selected() {
      this.isPosing = false;
      this.followed = "";
      if (!this.selected) this.isFollowing = false;
      this.connect();
      this.updateFacts();
      this.update();
      if (this.selected && !this.crowd?.robot(this.selected)) {
        this.isFollowing = true;
        this.follow();
      }
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
    side() { this.pose(); },
  },
};

// A robot in a cabin that travels has the height of the cabin.
function heightOf(body, plan, floor) {
  for (const state of Object.values(floor.elevators)) if (state.riders.includes(body.name)) return state.height;
  return plan.elevation;
}

// What a robot's display shows: the paper's working, waiting or exceptional, and more about it.
function displayed(agent) {
  if (!agent) return { display: "waiting", words: "" };
  const { condition, program } = agent;
  if (condition === "STOPPED") return { display: "exceptional", words: "stopped" };
  if (condition === "PAUSED") return { display: "waiting", words: "paused" };
  if (condition === "RUNNING") {
    const isWait = program.kind === "wait" || program.kind === "wait_until";
    return { display: isWait ? "waiting" : "working", words: program.kind };
  }
  return program.result === "FAILED" ? { display: "exceptional", words: "program failed" } : { display: "waiting", words: "" };
}
