// The keys of a page in a small list: "?" opens it, Escape or "?" closes it.

const ARROWS = "\u2190 \u2191 \u2192 \u2193";
const VIEW = [["+ \u2212", "enlarge, reduce"], ["0", "show everything"]];
const KEYS = {
  Monitor: [
    ...VIEW, [ARROWS, "move the view"], ["F", "follow the selected robot"],
    ["Shift click", "select several robots"], ["D, right click", "drive the selected robots there"],
    ["J", "drive a robot by hand: arrows, Q and E"],
    ["\u2191 \u2193", "in the table: the robot before, the next one"],
    ["\u2190 \u2192", "in tabs: the one before, the next one"],
    ["Q E", "turn what is being dragged"], ["Esc", "end dragging, a tool, following, the selection"],
  ],
  "3D": [
    [ARROWS, "on the scene: turn the view"], ...VIEW,
    [`${ARROWS} PgUp PgDn`, "while a hand is posed: move it"], [", . ; ' [ ]", "while a hand is posed: turn it"],
  ],
  Program: [
    ["\u2191 \u2193", "the icon before, the next one"], ["Enter, Esc", "to the fields of the icon, and back"],
    ["Alt \u2191 \u2193", "move the icon"], ["Alt \u2192 \u2190", "into the icon before, out of it"],
    ["Del", "remove the icon"],
    ["Ctrl C X V D", "copy, cut, paste, duplicate"], ["Ctrl Z Y", "undo, redo"], ["Ctrl S", "save"],
    [`${ARROWS} Q E`, "on the target's map: move and turn the target"],
  ],
  Map: [
    ...VIEW, [ARROWS, "move what is selected or a tool's cursor (far with Shift), else the view"],
    ["Space", "a point at the tool's cursor"], ["Enter", "end the line"], ["Backspace", "take the last corner back"],
    ["Del", "remove what is selected"], ["Ctrl Z Y", "undo, redo"], ["Ctrl A D", "select all, duplicate"],
    ["Esc", "end drawing, the tool, the selection"],
  ],
  Missions: [
    ["Tab", "the next mission or field"], ["Enter", "on a mission: show it"],
    [`${ARROWS} Q E`, "on the map: move and turn the ghost"],
  ],
};
const ALL = [["?", "this list"]];

export default {
  props: { page: String },
  template: `
    <span class="page-keys">
      <q-btn flat round dense icon="keyboard" aria-label="Keys of this page" title="Keys of this page (?)" ref="button"
             :aria-expanded="isOpen" @click="isOpen = !isOpen" />
      <section v-if="isOpen" ref="list" tabindex="-1" aria-label="Keys of this page">
        <h2>Keys of {{ page }} <q-btn flat round dense size="sm" icon="close" aria-label="Close" @click="close" /></h2>
        <dl><template v-for="([key, words], index) in keys" :key="index">
          <dt><kbd>{{ key }}</kbd></dt><dd>{{ words }}</dd></template></dl>
      </section>
    </span>`,
  data() {
    return { isOpen: false, tools: [] };
  },
  computed: {
    keys() {
      return [...(KEYS[this.page] ?? []), ...this.tools, ...ALL];
    },
  },
  watch: {
    isOpen() {
      if (!this.isOpen) return;
      this.before = document.activeElement;
      this.$nextTick(() => this.$refs.list?.focus());
      if (this.page === "Map" && !this.tools.length) this.loadTools();
    },
  },
  mounted() {
    // Before the page's own keys: Escape closes the list only.
    this.onKey = (event) => this.key(event);
    window.addEventListener("keydown", this.onKey, true);
  },
  unmounted() {
    window.removeEventListener("keydown", this.onKey, true);
  },
  methods: {
    key(event) {
      const isTyping = event.target.closest?.("input:not([type=range]), select, textarea, [contenteditable]");
      const isAsked = event.key === "?" && !isTyping && !event.ctrlKey && !event.metaKey && !event.altKey;
      if (isAsked && !this.isOpen) this.isOpen = true;
      else if (this.isOpen && (isAsked || event.key === "Escape")) this.close();
      else return;
      event.preventDefault();
      event.stopPropagation();
    },
    close() {
      this.isOpen = false;
      (this.before?.isConnected ? this.before : this.$refs.button.$el).focus();
    },
    async loadTools() {
      const { TOOLS } = await import("/static/map_tools.js");
      this.tools = TOOLS.filter(({ key }) => key).map(({ key, title }) => [key.toUpperCase(), title]);
    },
  },
};
