// Drives one robot by hand for as long as a key, a turn button or the stick is held. Each order is valid for 0.5 s: a
// page that is closed, or loses the console, sends no further one.
import { call } from "/static/calls.js";
import { live } from "/static/live.js";
import { unplaced } from "/static/segments.js";

// Interval between orders, and after this time the console does not answer [ms].
const ORDER_MS = 100, LIMIT_MS = 2000;
const TURN_RAD_PER_M = 2;
// Directions on the map: x, y, turn.
const KEYS = {
  ArrowUp: [0, 1, 0], ArrowDown: [0, -1, 0], ArrowRight: [1, 0, 0], ArrowLeft: [-1, 0, 0], q: [0, 0, 1], e: [0, 0, -1],
};

// The velocity in the frame of a robot with a heading [rad], for a direction on the map of at most 1, at a speed [m/s].
export function jogVelocity([x, y, turn], heading, speed) {
  const part = speed / Math.max(1, Math.hypot(x, y));
  const [[ahead, left]] = unplaced([[part * x, part * y]], { at: [0, 0], heading });
  return { ahead, left, turn: turn * speed * TURN_RAD_PER_M };
}

export default {
  // body(): where the robot is, with its heading.
  props: { robot: Object, body: Function },
  template: `
    <div class="jog-pad" role="group" aria-label="Drive by hand" @pointerup="release" @pointercancel="release">
      <button v-for="key in ['q', 'e']" :key="key" type="button" @pointerdown="hold(key, keys[key])"
              @pointerleave="release" @contextmenu.prevent>
        {{ key === "q" ? "\u21ba" : "\u21bb" }} {{ key.toUpperCase() }}</button>
      <div class="jog-stick" title="Drag: the robot drives there, by the map; the arrow keys do the same"
           @pointerdown="grip" @pointermove="held.stick && grip($event)">
        <i :style="held.stick && { translate: held.stick[0] * 40 + 'px ' + -held.stick[1] * 40 + 'px' }"></i></div>
      <label>{{ speed.toFixed(2) }} m/s
        <input v-model.number="speed" type="range" min="0.05" max="0.5" step="0.05"></label>
      <p v-if="problem" class="is-problem" role="alert">{{ problem }}</p>
    </div>`,
  data() {
    return { keys: KEYS, held: {}, speed: 0.2, problem: "" };
  },
  mounted() {
    this.closed = new AbortController();
    const { signal } = this.closed, early = { signal, capture: true }; // before the keys of the page
    for (const kind of ["keydown", "keyup"]) window.addEventListener(kind, (event) => this.key(event), early);
    for (const kind of ["blur", "visibilitychange"]) window.addEventListener(kind, () => this.release(), { signal });
    this.unlisten = live.listen(() => live.isConnected || this.release());
    this.timer = setInterval(() => this.order(), ORDER_MS);
  },
  unmounted() {
    this.closed.abort();
    this.unlisten();
    clearInterval(this.timer);
    this.release();
  },
  methods: {
    key(event) {
      const key = event.key.length > 1 ? event.key : event.key.toLowerCase(), { ctrlKey, altKey, metaKey, target } = event;
      if (!KEYS[key] || ctrlKey || altKey || metaKey || target.closest?.("input, select, textarea")) return;
      if (event.type === "keydown") this.hold(key, KEYS[key]);
      else this.release(key);
      event.preventDefault();
      event.stopPropagation();
    },
    grip(event) {
      event.target.setPointerCapture(event.pointerId);
      const { left, top, width, height } = event.currentTarget.getBoundingClientRect();
      const x = (2 * (event.clientX - left)) / width - 1, y = 1 - (2 * (event.clientY - top)) / height;
      const part = Math.max(1, Math.hypot(x, y));
      this.hold("stick", [x / part, y / part, 0]);
    },
    hold(what, direction) {
      this.held = { ...this.held, [what]: direction };
      this.problem = "";
    },
    // Let go of a key, or of everything.
    release(what) {
      const { [what]: _, ...others } = this.held;
      this.held = typeof what === "string" ? others : {};
      this.order();
    },
    // Order what is held, or once to stand; one call at a time, so that none overtakes another.
    async order() {
      const held = Object.values(this.held);
      if (this.isOrdering || !(held.length || this.isMoving)) return;
      this.isOrdering = true;
      this.isMoving = held.length > 0;
      const direction = held.reduce((sum, each) => sum.map((value, index) => value + each[index]), [0, 0, 0]);
      const velocity = jogVelocity(direction, this.body()?.heading ?? 0, this.speed);
      await call("jog", { robot: this.robot.name, ...velocity }, LIMIT_MS).catch((error) => {
        this.problem = error.message;
        this.held = {};
      });
      this.isOrdering = false;
      if (!Object.keys(this.held).length) this.order();
    },
  },
};
