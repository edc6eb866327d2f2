// Picks a place on the map: a click gives the point, a drag also the heading; arrows move it, [ and ] turn it.
import { FloorCanvas, middleOf } from "/static/floor_canvas.js";
import { live } from "/static/live.js";
import { shortened } from "/static/texts.js";

// A drag turns the target when it is longer than this [pixels].
const MIN_DRAG_PX = 12;
// Names are shown from this scale on [pixels per metre].
const NAMES_FROM = 24;
// Names of rooms: the width of a letter [pixels], and how much wider than its room a name may be.
const LETTER_PX = 6.5, OVERHANG = 1.4;
// Steps of the keys.
const STEP_M = 0.1, STEP_RAD = Math.PI / 12;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export const TargetMap = {
  // target: {floor, x, y, heading}, each may be missing. others: targets of the program's other icons. robot: is marked
  // on the map; robotFloor: the floor that is shown first. isOneFloor: the target has no floor of its own.
  props: { target: Object, others: Array, robot: String, robotFloor: String, isOneFloor: Boolean },
  emits: ["pick"], // values of the target, and whether that is a new choice, not the same one dragged on
  template: `
    <section class="target-map" aria-label="Target on the map">
      <div class="console-tabs" role="tablist" aria-label="Floors">
        <button v-for="each in floors" :key="each" type="button" role="tab" :aria-selected="each === floor"
                @click="show(each)">{{ each }}</button>
        <span class="target-help">click: place, drag: heading</span>
      </div>
      <div class="console-scene">
        <canvas ref="canvas" tabindex="0" aria-label="Map. Click the target; arrow keys move it, [ and ] turn it."
                @keydown="key"></canvas>
        <div v-if="message" class="console-overlay">{{ message }}</div>
        <div class="console-tools">
          <q-btn dense flat size="sm" icon="fit_screen" aria-label="Show the whole floor"
                 @click="canvas.fit()" />
          <q-btn dense flat size="sm" icon="add" aria-label="Enlarge" @click="canvas.zoom(1.4)" />
          <q-btn dense flat size="sm" icon="remove" aria-label="Reduce"
                 @click="canvas.zoom(1 / 1.4)" />
        </div>
      </div>
    </section>`,
  data() {
    return { floors: [], floor: "", message: "loading the map" };
  },
  watch: {
    robot() {
      this.canvas.selected = this.robot;
      this.canvas.redraw();
    },
    target() {
      if (this.target.floor && this.floors.includes(this.target.floor)) this.show(this.target.floor);
      this.canvas?.redraw();
    },
    others() {
      this.canvas?.redraw();
    },
  },
  mounted() {
    this.canvas = new FloorCanvas(this.$refs.canvas, { pointer: (...news) => this.pointer(...news) });
    this.canvas.overlays = [{
      above: (context, canvas) => this.draw(context, canvas), labels: (context, canvas) => this.drawRooms(canvas),
    }];
    this.canvas.areNamesShown = false; // set for each picture
    this.canvas.selected = this.robot;
    this.unlisten = live.listen((kind, name) => this.news(kind, name));
    this.recolor = () => this.canvas.redraw();
    window.addEventListener("robocorba-colors", this.recolor);
    this.news("connection");
  },
  unmounted() {
    this.unlisten();
    live.want(this);
    window.removeEventListener("robocorba-colors", this.recolor);
    this.canvas.close();
  },
  methods: {
    news(kind, name) {
      if (kind === "connection") {
        this.floors = live.names;
        const wanted = [this.target.floor, this.floor, this.robotFloor, this.floors[0]];
        this.show(wanted.find((floor) => this.floors.includes(floor)) ?? "");
      }
      if (kind === "plan") this.showPlan();
      if (kind === "floor" && name === this.floor) this.canvas.redraw();
    },
    show(floor) {
      if (floor !== this.floor) {
        this.floor = floor;
        live.want(this, floor ? { floors: [floor] } : undefined);
        this.canvas.floor = floor ? live.floor(floor) : null;
      }
      this.showPlan();
    },
    showPlan() {
      const plan = this.floor ? live.plan(this.floor) : undefined;
      if (plan) this.canvas.setPlan(plan);
      const waiting = live.problems.map || live.problems.floors;
      this.message = plan ? "" : waiting || (live.isConnected ? "loading the map" : "connecting");
    },
    // ---- picking ----
    pointer(kind, event, [x, y]) {
      if (kind === "down") {
        this.began = { px: event.clientX, py: event.clientY, x, y };
        this.pick({ x, y }, true);
        return true;
      }
      if ((kind === "move" || kind === "up") && this.began) {
        const { px, py } = this.began;
        if (Math.hypot(event.clientX - px, event.clientY - py) >= MIN_DRAG_PX) {
          this.pick({ x: this.began.x, y: this.began.y, heading: Math.atan2(y - this.began.y, x - this.began.x) });
        }
      }
      if (kind === "up" || kind === "cancel") {
        this.began = null;
      }
      return false;
    },
    pick({ x, y, heading }, isNew = false) {
      const values = { x: Number(x.toFixed(2)), y: Number(y.toFixed(2)) };
      if (heading !== undefined) values.heading = Number(heading.toFixed(3));
      if (!this.isOneFloor) values.floor = this.floor;
      if (this.floor) this.$emit("pick", values, isNew);
    },
    key(event) {
      const { x, y, heading } = this.target;
      const arrow = ARROWS[event.key], turn = { "[": STEP_RAD, "]": -STEP_RAD }[event.key];
      if (arrow) {
        const [fromX, fromY] = typeof x === "number" && typeof y === "number" ? [x, y] : this.canvas.centre;
        this.pick({ x: fromX + arrow[0] * STEP_M, y: fromY + arrow[1] * STEP_M });
      } else if (turn && typeof x === "number" && typeof y === "number") {
        this.pick({ x, y, heading: Math.atan2(Math.sin((heading ?? 0) + turn), Math.cos((heading ?? 0) + turn)) });
      } else if (event.key === "+" || event.key === "-") {
        this.canvas.zoom(event.key === "+" ? 1.4 : 1 / 1.4);
      } else if (event.key === "0") {
        this.canvas.fit();
      } else {
        return;
      }
      event.preventDefault();
      event.stopPropagation();
    },
    // ---- drawing ----
    draw(context, canvas) {
      canvas.areNamesShown = canvas.scale > NAMES_FROM;
      const others = this.others.filter((other) => !other.floor || other.floor === this.floor);
      for (const other of others) this.drawOther(context, canvas, other);
      const { floor, x, y, heading } = this.target;
      if (typeof x !== "number" || typeof y !== "number" || (floor && floor !== this.floor)) return;
      const radius = Math.max(canvas.px(9), 0.4);
      context.strokeStyle = canvas.colors.selected;
      context.lineWidth = canvas.px(3);
      context.beginPath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
      context.moveTo(x - radius / 3, y);
      context.lineTo(x + radius / 3, y);
      context.moveTo(x, y - radius / 3);
      context.lineTo(x, y + radius / 3);
      if (typeof heading === "number") this.addArrow(context, x, y, heading, radius);
      context.stroke();
    },
    // On a small map the rooms have their names; on a large one everything has.
    drawRooms(canvas) {
      if (canvas.areNamesShown) return;
      for (const { name, polygon } of canvas.plan.areas) {
        const text = shortened(name, 16), xs = polygon.map(([x]) => x);
        const width = (Math.max(...xs) - Math.min(...xs)) * canvas.scale;
        if (LETTER_PX * text.length < OVERHANG * width) canvas.drawAreaName(text, middleOf(polygon));
      }
    },
    addArrow(context, x, y, heading, radius) {
      const at = (angle, length) => [x + length * Math.cos(angle), y + length * Math.sin(angle)];
      context.moveTo(...at(heading, radius));
      context.lineTo(...at(heading, 1.9 * radius));
      context.lineTo(...at(heading + 0.18, 1.5 * radius));
      context.moveTo(...at(heading, 1.9 * radius));
      context.lineTo(...at(heading - 0.18, 1.5 * radius));
    },
    drawOther(context, canvas, { x, y }) {
      context.strokeStyle = canvas.colors.path;
      context.lineWidth = canvas.px(2);
      context.beginPath();
      context.arc(x, y, canvas.px(6), 0, 2 * Math.PI);
      context.stroke();
    },
  },
};
