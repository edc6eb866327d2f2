// Picks a place on the map: a click gives the point, a drag also the heading; arrows move it, Q and E turn it. The place
// of an object is that of its ghost, which is dragged, and turned by its tip.
import { cross, line, ring } from "/static/canvas_shapes.js";
import { FloorCanvas } from "/static/floor_canvas.js";
import { live } from "/static/live.js";
import { middleOf } from "/static/segments.js";
import TabList from "/static/tab_list.js";
import { drawGhost, headingTo, partAt } from "/static/target_ghost.js";
import { shortened } from "/static/texts.js";
import ViewTools from "/static/view_tools.js";

// A drag turns the target when it is longer than this [pixels].
const MIN_DRAG_PX = 12;
// Names are shown from this scale on [pixels per metre].
const NAMES_FROM = 24;
// Names of rooms: the width of a letter [pixels], and how much wider than its room a name may be.
const LETTER_PX = 6.5, OVERHANG = 1.4;
// Steps of the keys.
const STEP_M = 0.1, STEP_RAD = Math.PI / 12;
const TURNS = { q: STEP_RAD, "[": STEP_RAD, e: -STEP_RAD, "]": -STEP_RAD };
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export const TargetMap = {
  // target: {floor, x, y, heading}, each may be missing. others: targets of the program's other icons. robot: is marked
  // on the map; robotFloor: the floor that is shown first. isOneFloor: the target has no floor of its own. outline: of
  // the object that is to stand at the target, in its own frame. objects: names of those that can be chosen. verdict:
  // "good" or "bad" colours the ghost. coming: names of robots that are marked.
  components: { TabList, ViewTools },
  props: {
    target: Object, others: { type: Array, default: () => [] }, robot: String, robotFloor: String, isOneFloor: Boolean,
    outline: Array, objects: { type: Array, default: () => [] }, verdict: String,
    coming: { type: Array, default: () => [] },
  },
  // pick: values of the target, and whether that is a new choice, not the same one dragged on. choose: an object's name.
  emits: ["pick", "choose"],
  template: `
    <section class="target-map" aria-label="Target on the map">
      <TabList label="Floors" :names="floors" :chosen="floor" @choose="show"><span class="target-help">{{ help }}</span>
      </TabList>
      <div class="console-scene">
        <canvas ref="canvas" tabindex="0" :aria-label="label"
                @keydown="key"></canvas>
        <div v-if="message" class="console-overlay">{{ message }}</div>
        <ViewTools :canvas="() => canvas" />
      </div>
    </section>`,
  data() {
    return {
      floors: [], floor: "", message: "loading the map",
      label: "Map. Click the target; arrow keys move it, Q and E turn it.",
    };
  },
  computed: {
    help() {
      if (!this.objects.length) return "click: place, drag: heading";
      return this.outline ? "drag it to its goal; turn it by the tip, or Q and E" : "click the object to carry";
    },
    isHere() {
      const { floor, x, y } = this.target;
      return typeof x === "number" && typeof y === "number" && (!floor || floor === this.floor);
    },
  },
  watch: {
    outline: "redraw", others: "redraw", verdict: "redraw", coming: "redraw",
    robot() {
      this.canvas.selected = this.robot;
      this.canvas.redraw();
    },
    target() {
      if (this.target.floor && this.floors.includes(this.target.floor)) this.show(this.target.floor);
      this.redraw();
    },
  },
  mounted() {
    this.canvas = new FloorCanvas(this.$refs.canvas, { pointer: (...news) => this.pointer(...news) });
    this.canvas.overlays = [{
      above: (context, canvas) => this.draw(context, canvas), labels: (_, canvas) => this.drawRooms(canvas),
    }];
    this.canvas.areNamesShown = false; // set for each picture
    this.canvas.selected = this.robot;
    this.canvas.describe = ({ name }) => (this.coming.includes(name) ? { color: this.canvas.colors.node } : {});
    this.unlisten = live.listen((kind, name) => this.news(kind, name));
    this.news("connection");
  },
  unmounted() {
    this.unlisten();
    live.want(this);
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
    redraw() {
      this.canvas?.redraw();
    },
    // ---- picking ----
    pointer(kind, event, point) {
      if (kind === "down" && event.button === 0) {
        this.press(event, point);
        return true;
      }
      if ((kind === "move" || kind === "up") && this.began) this.drag(event, point);
      if (kind === "up" || kind === "cancel") this.began = null;
      return false;
    },
    // What is dragged on: the ghost from `from`, or a heading.
    press(event, point) {
      const [x, y] = point, { outline, target, canvas } = this;
      const part = outline && this.isHere ? partAt(point, outline, target, canvas.scale) : "";
      const object = part ? undefined : canvas.bodyAt(point, ({ kind, name }) => kind === "object"
        && this.objects.includes(name));
      const from = part === "body" ? target : object ? { x: object.x, y: object.y } : outline && !part ? { x, y } : null;
      this.began = { px: event.clientX, py: event.clientY, x, y, from, at: part ? target : { x, y } };
      if (object) this.$emit("choose", object.name);
      else if (!part) this.pick({ x, y }, true);
    },
    drag(event, [x, y]) {
      const { px, py, from, at } = this.began;
      if (Math.hypot(event.clientX - px, event.clientY - py) < MIN_DRAG_PX && !this.began.isFar) return;
      this.began.isFar = true;
      if (from) this.pick({ x: from.x + x - this.began.x, y: from.y + y - this.began.y });
      else this.pick({ ...at, heading: this.outline ? headingTo(at, [x, y]) : Math.atan2(y - at.y, x - at.x) });
    },
    pick({ x, y, heading }, isNew = false) {
      const values = { x: Number(x.toFixed(2)), y: Number(y.toFixed(2)) };
      if (heading !== undefined) values.heading = Number(heading.toFixed(3));
      if (!this.isOneFloor) values.floor = this.floor;
      if (this.floor) this.$emit("pick", values, isNew);
    },
    key(event) {
      const { x, y, heading } = this.target;
      const arrow = ARROWS[event.key], turn = TURNS[event.key.toLowerCase()];
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
      const { x, y, heading } = this.target, { colors } = canvas;
      if (!this.isHere) return;
      if (this.outline) {
        const color = { good: colors.node, bad: colors.collision }[this.verdict] ?? colors.selected;
        drawGhost(context, canvas, this.outline, this.target, color);
        return;
      }
      const radius = Math.max(canvas.px(9), 0.4);
      context.strokeStyle = canvas.colors.selected;
      context.lineWidth = canvas.px(3);
      ring(context, x, y, radius);
      cross(context, [x, y], radius / 3);
      if (typeof heading === "number") this.drawArrow(context, x, y, heading, radius);
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
    drawArrow(context, x, y, heading, radius) {
      const at = (angle, length) => [x + length * Math.cos(angle), y + length * Math.sin(angle)];
      line(context, at(heading, radius), at(heading, 1.9 * radius));
      for (const side of [0.18, -0.18]) line(context, at(heading, 1.9 * radius), at(heading + side, 1.5 * radius));
    },
    drawOther(context, canvas, { x, y }) {
      context.strokeStyle = canvas.colors.path;
      context.lineWidth = canvas.px(2);
      ring(context, x, y, canvas.px(6));
    },
  },
};
