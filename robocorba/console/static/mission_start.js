// The form that starts a mission: kind, leader, object, and the target on a map.
import { FloorCanvas, line, polygon } from "/static/floor_canvas.js";
import { titleOf } from "/static/icon_looks.js";
import { call, live } from "/static/live.js";
import { Schema } from "/static/program_model.js";
import { rememberView, sharedView } from "/static/shared_view.js";

// The icons of missions; their parameters come from the schema of programs.
const COOPERATIVE = ["move_table", "hand_over"];
const ROBOTS = ["taker", "giver"];
const OBJECTS = ["table", "object"];
const LEADERS_MS = 3000;
const TURN_PX = 12;

export const MissionStart = {
  emits: ["started"],
  template: `
    <form class="mission-start" @submit.prevent="start" aria-label="Start a mission">
      <h2 class="console-heading">Start a mission</h2>
      <label class="map-field"><span>kind</span><select v-model="kind"><option v-for="each in kinds" :key="each"
          :value="each">{{ titleOf(each) }}</option></select></label>
      <label class="map-field"><span>leader</span><select v-model="leader">
        <option value=""
            disabled>{{ leaders === null ? 'asking the robots' : leaders.length ? 'choose a robot' : 'no robots'
              }}</option>
        <option v-for="each in leaders ?? []" :key="each.robot" :value="each.robot"
            :disabled="!each.free">{{ each.robot }}{{ each.free ? '' : ' (' + each.why + ')'
              }}</option></select></label>
      <template v-for="parameter in parameters" :key="parameter.name">
        <label v-if="isRobot(parameter)"
            class="map-field"><span>{{ parameter.name }}{{ parameter.isRequired ? '' : ' (optional)' }}</span>
          <select v-model="values[parameter.name]"><option
              value="">{{ parameter.isRequired ? 'choose a robot' : 'the leader' }}</option>
            <option v-for="each in leaders ?? []" :key="each.robot">{{ each.robot }}</option></select></label>
        <label v-else-if="isObject(parameter)" class="map-field"><span>object</span>
          <select v-model="values[parameter.name]" @change="showObject(values[parameter.name])">
            <option value=""
                disabled>{{ objects.length ? 'choose an object' : 'no movable objects on the map' }}</option>
            <option v-for="each in objects" :key="each.floor + each.name"
                :value="each.name">{{ each.name }} ({{ each.floor }})</option></select></label>
        <template v-else-if="isPlace(parameter)">
          <p class="map-none">Target: click on the map; drag to turn.</p>
          <label class="map-field"><span>floor</span><select v-model="target.floor" @change="chooseFloor"><option
              v-for="floor in floors" :key="floor">{{ floor }}</option></select></label>
          <div class="mission-map"><canvas ref="canvas" tabindex="0"
              aria-label="Target on the map; the fields below hold it, too"></canvas></div>
          <div class="mission-pose"><label v-for="[key, title, step] in pose" :key="key">{{ title }} <input
              type="number" :step="step" :value="draft[key] ?? shown(key)"
              @input="draft[key] = $event.target.value" @change="setPose(key, $event.target)"></label></div>
        </template>
        <label v-else class="map-field"><span>{{ parameter.name }}</span><input v-model="values[parameter.name]"
            maxlength="200"></label>
      </template>
      <p v-if="problem" class="map-note" role="alert">{{ problem }}</p>
      <div class="console-actions"><q-btn dense no-caps color="primary" icon="play_arrow" label="Start" type="submit"
          :loading="isStarting" :disable="Boolean(missing)" />
        <span class="map-none">{{ missing }}</span></div>
    </form>`,
  data() {
    return {
      kinds: [], kind: "", leader: "", leaders: null, values: {}, objects: [], floors: [],
        parameters: [],
      target: { floor: "", x: null, y: null, heading: 0 }, pose: [["x", "x m", 0.05], ["y", "y m", 0.05], ["heading",
        "heading \u00b0", 15]],
      draft: {}, problem: "", isStarting: false, // draft: what is being typed; news must not replace it
    };
  },
  computed: {
    missing() {
      if (!this.kind) return "loading";
      if (!this.leader) return "choose a leader";
      for (const parameter of this.parameters) {
        if (this.isPlace(parameter) && (this.target.x === null || this.target.y === null)) return "pick a target on the map";
        if (!this.isPlace(parameter) && parameter.isRequired
          && !this.values[parameter.name]) return `choose: ${parameter.name}`;
      }
      return "";
    },
  },
  watch: {
    kind() {
      this.closeCanvas();
      this.parameters = this.schema.parameters(this.schema.icons.get(this.kind));
      this.values = Object.fromEntries(this.parameters.map((parameter) => [parameter.name, ""]));
      this.$nextTick(() => this.openCanvas());
    },
  },
  mounted() {
    this.unlisten = live.listen((kind, name) => this.receive(kind, name));
    this.recolor = () => this.canvas?.redraw();
    window.addEventListener("robocorba-colors", this.recolor);
    this.loadSchema();
    this.askLeaders();
    this.receive("connection");
  },
  unmounted() {
    this.isClosed = true;
    this.unlisten();
    live.want(this);
    clearTimeout(this.timer);
    clearTimeout(this.schemaTimer);
    window.removeEventListener("robocorba-colors", this.recolor);
    this.closeCanvas();
  },
  methods: {
    titleOf,
    isRobot: ({ name }) => ROBOTS.includes(name),
    isObject: ({ name }) => OBJECTS.includes(name),
    isPlace: ({ properties }) => Boolean(properties?.floor && properties.x && properties.y),
    async loadSchema() {
      try {
        const { schema } = await call("program_schema");
        this.schema = new Schema(schema);
        this.kinds = COOPERATIVE.filter((icon) => this.schema.icons.has(icon));
        this.kind = this.kinds[0] ?? "";
      } catch (error) {
        this.problem = error.message;
        if (!this.isClosed) this.schemaTimer = setTimeout(() => this.loadSchema(), LEADERS_MS);
      }
    },
    async askLeaders() {
      try {
        const leaders = await call("leaders");
        this.leaders = leaders.sort((a, b) => b.free - a.free || a.robot.localeCompare(b.robot));
        if (!this.leaders.some((each) => each.robot === this.leader && each.free)) this.leader = "";
      } catch {
        this.leaders = this.leaders ?? []; // the page's header says that the connection is lost
      }
      if (!this.isClosed) this.timer = setTimeout(() => this.askLeaders(), LEADERS_MS);
    },
    receive(kind, name) {
      if (kind === "connection" || kind === "plan") {
        this.floors = live.names;
        const first = this.floors.includes(sharedView.floor) ? sharedView.floor : this.floors[0] ?? "";
        if (!this.floors.includes(this.target.floor)) this.target.floor = first;
        this.objects = movables(this.floors);
        this.show();
      }
      if (kind === "floor" && name === this.target.floor) this.canvas?.redraw();
    },

    // ---- target ----

    openCanvas() {
      const canvas = [this.$refs.canvas].flat()[0];
      if (!canvas || this.canvas) return;
      this.canvas = new FloorCanvas(canvas, { pointer: (...news) => this.pointer(...news) });
      this.canvas.areNamesShown = false; // too many for a small map
      this.canvas.overlays.push({ above: (context) => this.drawTarget(context) });
      this.show();
    },
    closeCanvas() {
      this.canvas?.close();
      this.canvas = null;
    },
    show() {
      const { floor } = this.target;
      live.want(this, floor && this.canvas ? { floors: [floor] } : undefined);
      if (!this.canvas || !floor) return;
      this.canvas.floor = live.floor(floor);
      const plan = live.plan(floor);
      if (plan) this.canvas.setPlan(plan);
      this.canvas.redraw();
    },
    chooseFloor() {
      rememberView({ floor: this.target.floor });
      this.show();
    },
    showObject(name) {
      const object = this.objects.find((each) => each.name === name);
      if (this.canvas) this.canvas.selected = name;
      if (object && this.target.x === null && this.target.y === null) this.target.floor = object.floor;
      this.show();
    },
    pointer(kind, event, point) {
      if (kind === "down" && event.button === 0) {
        this.press = [event.clientX, event.clientY];
        this.target.x = Math.round(point[0] * 20) / 20;
        this.target.y = Math.round(point[1] * 20) / 20;
      } else if (kind === "move" && this.press && Math.hypot(event.clientX - this.press[0],
        event.clientY - this.press[1]) > TURN_PX) {
        const angle = Math.atan2(point[1] - this.target.y, point[0] - this.target.x);
        this.target.heading = (Math.round((angle * 12) / Math.PI) * Math.PI) / 12;
      } else if (kind === "up" || kind === "cancel") this.press = null;
      this.canvas.redraw();
      return kind === "down" && event.button === 0;
    },
    shown(key) {
      const value = this.target[key];
      if (value === null) return "";
      return Number((key === "heading" ? (value * 180) / Math.PI : value).toFixed(3));
    },
    setPose(key, input) {
      const value = input.valueAsNumber;
      delete this.draft[key];
      if (!Number.isFinite(value)) input.value = this.shown(key);
      else this.target[key] = key === "heading" ? (value * Math.PI) / 180 : value;
      this.canvas?.redraw();
    },
    // The object's outline and its heading at the target.
    drawTarget(context) {
      const { x, y, heading } = this.target;
      if (x === null || y === null) return;
      const { canvas } = this;
      const object = this.objects.find((each) => each.name === (this.values.table || this.values.object));
      context.save();
      context.translate(x, y);
      context.rotate(heading);
      context.strokeStyle = context.fillStyle = canvas.colors.selected;
      context.lineWidth = canvas.px(2);
      if (object) {
        const cos = Math.cos(-object.heading), sin = Math.sin(-object.heading);
        const own = object.polygon.map(([px, py]) => [px - object.at[0], py - object.at[1]]);
        polygon(context, own.map(([px, py]) => [px * cos - py * sin, px * sin + py * cos]));
        context.globalAlpha = 0.25;
        context.fill();
        context.globalAlpha = 1;
        context.stroke();
      }
      const length = canvas.px(26), head = canvas.px(7);
      line(context, [0, 0], [length, 0]);
      line(context, [length, 0], [length - head, head]);
      line(context, [length, 0], [length - head, -head]);
      context.beginPath();
      context.arc(0, 0, canvas.px(5), 0, 2 * Math.PI);
      context.fill();
      context.restore();
    },

    // ---- start ----

    async start() {
      if (this.missing) return;
      const icon = { icon: this.kind };
      for (const parameter of this.parameters) {
        if (this.isPlace(parameter)) icon[parameter.name] = { ...this.target };
        else if (this.values[parameter.name]) icon[parameter.name] = this.values[parameter.name];
      }
      this.isStarting = true;
      this.problem = "";
      try {
        this.$emit("started", await call("start_mission", { leader: this.leader, icon }));
      } catch (error) {
        this.problem = error.message;
      } finally {
        this.isStarting = false;
      }
    },
  },
};

// The movable objects of all floors, under the names by which robots know them: an object whose name several floors
// have is FLOOR/NAME. A line has no mass.
function movables(floors) {
  const isMovable = ({ movable, polygon }) => movable && polygon.length > 2;
  const found = floors.flatMap((floor) => {
    const objects = live.plan(floor)?.objects ?? [];
    return objects.filter(isMovable).map((object) => ({ ...object, floor }));
  });
  const count = new Map();
  for (const { name } of found) count.set(name, (count.get(name) ?? 0) + 1);
  return found.map((object) => ({ ...object, name: count.get(object.name) > 1 ? `${object.floor}/${object.name}`
    : object.name }));
}
