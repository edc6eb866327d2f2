// The 3D simulator: floors with walls cut away, articulated robots at their joint angles, plain bodies for the rest.
import { OrbitControls, THREE } from "nicegui-scene";
import { FloorMesh } from "/static/floor_mesh.js";
import { live } from "/static/live.js";
import { ArticulatedRobot, PlainRobots, RobotShape } from "/static/robot_model.js";

const CUT_M = 1.3;

export default {
  template: `
    <div style="display: flex; flex-direction: column; min-height: 0">
      <div class="console-tabs" role="tablist" aria-label="Floors">
        <button v-for="floor in floors" :key="floor" role="tab" :aria-selected="!isStacked && floor === current"
                @click="show(floor)">{{ floor }}</button>
        <button role="tab" :aria-selected="isStacked" @click="stack">all floors</button>
        <span style="flex: 1"></span>
        <label style="display: flex; align-items: center; gap: 6px">robot
          <select v-model="followed" aria-label="Follow a robot"><option value="">free camera</option>
            <option v-for="name in robots" :key="name" :value="name">{{ name }}</option></select></label>
        <label style="display: flex; align-items: center; gap: 6px">walls
          <input type="range" min="0.1" max="3" step="0.1" v-model.number="cut" @change="rebuild" aria-label="Height of walls"></label>
      </div>
      <div class="console-scene" ref="scene"><canvas ref="canvas" tabindex="0" aria-label="3D view"></canvas>
        <div v-if="message" class="console-overlay">{{ message }}</div></div>
    </div>`,
  data() {
    return { floors: [], current: "", isStacked: false, robots: [], followed: "", cut: CUT_M, message: "connecting" };
  },
  async mounted() {
    this.three = { floors: new Map(), articulated: new Map() };
    this.unlisten = live.listen((kind, name) => this.news(kind, name));
    this.recolor = () => this.setBackground();
    window.addEventListener("robocorba-colors", this.recolor);
    const answer = await fetch("/robot-model").catch(() => null);
    if (!answer?.ok) {
      this.message = "the robot's model is not available";
      return;
    }
    this.three.shape = new RobotShape(await answer.json());
    this.setUp();
    this.news("connection");
  },
  unmounted() {
    this.unlisten();
    live.want(this);
    window.removeEventListener("robocorba-colors", this.recolor);
    cancelAnimationFrame(this.frame);
    this.observer?.disconnect();
    this.three.renderer?.dispose();
  },
  methods: {
    setUp() {
      const { three } = this;
      three.scene = new THREE.Scene();
      three.camera = new THREE.PerspectiveCamera(45, 1, 0.05, 500);
      three.camera.up.set(0, 0, 1);
      three.scene.add(new THREE.HemisphereLight(0xffffff, 0x667788, 2.2));
      const sun = new THREE.DirectionalLight(0xffffff, 1.4);
      sun.position.set(-8, -14, 20);
      three.scene.add(sun);
      three.plain = new PlainRobots();
      three.scene.add(three.plain.group);
      this.makeRenderer();
      this.observer = new ResizeObserver(() => this.resize());
      this.observer.observe(this.$refs.scene);
      this.resize();
      this.setBackground();
      const loop = () => {
        this.frame = requestAnimationFrame(loop);
        if (this.isDirty || this.three.controls.update()) this.draw();
      };
      loop();
    },
    makeRenderer() {
      const canvas = this.$refs.canvas;
      this.three.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, powerPreference: "low-power" });
      this.three.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 1.5));
      this.three.controls ??= new OrbitControls(this.three.camera, canvas);
      this.three.controls.maxPolarAngle = 1.5;
      canvas.addEventListener("webglcontextlost", (event) => {
        event.preventDefault();
        this.message = "the graphics were reset; waiting";
      });
      canvas.addEventListener("webglcontextrestored", () => {
        this.message = "";
        this.isDirty = true;
      });
    },
    setBackground() {
      if (!this.three?.scene) return;
      this.three.scene.background = new THREE.Color(document.body.classList.contains("body--dark") ? 0x14181c : 0xdfe6ec);
      this.isDirty = true;
    },
    resize() {
      const box = this.$refs.scene.getBoundingClientRect();
      if (!box.width || !box.height) return;
      this.three.renderer.setSize(box.width, box.height);
      this.three.camera.aspect = box.width / box.height;
      this.three.camera.updateProjectionMatrix();
      this.isDirty = true;
    },
    news(kind, name) {
      if (!this.three.scene) return;
      if (kind === "connection") {
        this.floors = live.names;
        if (!this.floors.includes(this.current) && this.floors.length) this.show(this.floors[0]);
        this.message = this.floors.length ? "" : live.problems.floors || "connecting";
      }
      if (kind === "connection" || kind === "plan") this.loadPlans();
      if (kind === "floor" || kind === "state" || kind === "postures") this.update();
    },
    show(floor) {
      this.isStacked = false;
      this.current = floor;
      this.followed = "";
      live.want(this, { floors: [floor], postures: true });
      this.loadPlans();
      this.look();
    },
    stack() {
      this.isStacked = true;
      live.want(this, { floors: this.floors, postures: true });
      this.loadPlans();
      this.look();
    },
    shown() {
      return this.isStacked ? this.floors : [this.current].filter(Boolean);
    },
    loadPlans() {
      const { floors, scene } = this.three;
      for (const [name, mesh] of floors) {
        if (!this.shown().includes(name) || mesh.plan !== live.plan(name)) {
          mesh.close();
          floors.delete(name);
        }
      }
      for (const name of this.shown()) {
        const plan = live.plan(name);
        if (!plan || floors.has(name)) continue;
        const mesh = new FloorMesh(plan, this.cut);
        floors.set(name, mesh);
        scene.add(mesh.group);
        if (floors.size === 1) this.look();
      }
      this.update();
    },
    rebuild() {
      for (const mesh of this.three.floors.values()) mesh.build(this.cut);
      this.update();
    },
    look() {
      const plans = this.shown().map((name) => live.plan(name)).filter(Boolean);
      if (!plans.length) return;
      const [x0, y0, x1, y1] = plans[0].bounds;
      const height = plans.reduce((sum, plan) => sum + plan.elevation, 0) / plans.length;
      const size = Math.max(x1 - x0, y1 - y0);
      this.three.controls.target.set((x0 + x1) / 2, (y0 + y1) / 2, height);
      this.three.camera.position.set((x0 + x1) / 2 - size * 0.15, y0 - size * 0.55, height + size * 0.75);
      this.isDirty = true;
    },
    update() {
      const { three } = this;
      const plain = [], names = [], present = new Set();
      for (const [floorName, mesh] of three.floors) {
        const floor = live.floor(floorName);
        const bodies = [...floor.bodies.values()];
        mesh.setElevators(floor.elevators);
        mesh.setObjects(bodies.filter((body) => body.kind === "object"));
        for (const body of bodies) {
          if (body.kind !== "robot") continue;
          names.push(body.name);
          const z = this.heightOf(body, mesh.plan, floor);
          const joints = live.joints(body.name);
          if (joints) {
            present.add(body.name);
            this.articulate(body, z, joints);
          } else {
            plain.push({ ...body, z });
          }
        }
      }
      for (const [name, robot] of three.articulated) {
        if (present.has(name)) continue;
        robot.group.removeFromParent();
        robot.close();
        three.articulated.delete(name);
      }
      three.plain.set(plain);
      names.sort();
      if (names.join() !== this.robots.join()) this.robots = names;
      this.follow();
      this.isDirty = true;
    },
    // A robot in a cabin that travels has the height of the cabin.
    heightOf(body, plan, floor) {
      for (const state of Object.values(floor.elevators)) if (state.riders.includes(body.name)) return state.height;
      return plan.elevation;
    },
    articulate(body, z, joints) {
      const { articulated, shape, scene } = this.three;
      let robot = articulated.get(body.name);
      if (!robot) {
        robot = new ArticulatedRobot(shape);
        articulated.set(body.name, robot);
        scene.add(robot.group);
      }
      robot.group.position.set(body.x, body.y, z);
      robot.group.rotation.z = body.heading;
      robot.pose(joints);
      const agent = live.state?.robots[body.name]?.state;
      robot.show(displayed(agent), agent?.program.kind ?? "");
    },
    follow() {
      if (!this.followed) return;
      for (const name of this.three.floors.keys()) {
        const body = live.floor(name).body(this.followed);
        if (!body) continue;
        const target = this.three.controls.target;
        const moved = new THREE.Vector3(body.x, body.y, this.heightOf(body, live.plan(name), live.floor(name)) + 0.7).sub(target);
        if (this.followedBefore !== this.followed) {
          this.three.camera.position.set(body.x - 2.6 * Math.cos(body.heading - 0.5), body.y - 2.6 * Math.sin(body.heading - 0.5), target.z + moved.z + 1.3);
        } else {
          this.three.camera.position.add(moved);
        }
        target.add(moved);
      }
      this.followedBefore = this.followed;
    },
    draw() {
      this.isDirty = false;
      this.three.renderer.render(this.three.scene, this.three.camera);
      this.pictures = (this.pictures ?? 0) + 1;
    },
  },
  watch: {
    followed() {
      if (this.three?.scene) this.follow();
      this.isDirty = true;
    },
  },
};

// The paper's states of the robot's display.
function displayed(agent) {
  if (!agent || agent.condition === "IDLE" || agent.condition === "PAUSED") return "waiting";
  return agent.condition === "STOPPED" ? "exceptional" : "working";
}
