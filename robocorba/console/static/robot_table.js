// All robots that were seen, also those that are lost; a row selects, arrow keys go to the next one. A press on a column
// sorts by it, another one turns the order; many robots can be searched.
const COLUMNS = { Robot: "name", Floor: "floor", State: "word", Program: "program", News: "age" };
// Fewer robots need no search.
const MANY = 8;

export default {
  // note: said above the table. also: names of further selected robots. select: a name, and whether it is beside others.
  props: { robots: Array, selected: String, also: Array, isConnected: Boolean, note: String },
  emits: ["select"],
  template: `
    <div class="robot-table">
      <p v-if="note" class="panel-note" role="status">{{ note }}</p>
      <input v-if="robots.length > ${MANY}" v-model="wanted" type="search" class="robot-search"
             placeholder="search: name, floor, state, program" aria-label="Search robots">
      <table class="console-table">
        <thead><tr>
          <th v-for="title in titles" :key="title" :aria-sort="orderOf(title)">
            <button @click="sort(title)" :title="'Sort by ' + title.toLowerCase()">{{ title }}</button></th>
        </tr></thead>
        <tbody>
          <tr v-for="(robot, index) in rows" :key="robot.name" :data-row="index" tabindex="0"
              :class="{ 'is-lost': robot.isLost }" :aria-selected="[selected, ...also].includes(robot.name)"
              @mousedown.shift.prevent @click="$emit('select', robot.name, $event.shiftKey)" @keydown="key($event, index)">
            <td :title="robot.name">{{ robot.name }}</td>
            <td :title="robot.floor">{{ robot.floor }}</td>
            <td :title="robot.problem || robot.display.text"
                :class="{ 'is-problem': robot.display.kind === 'exceptional' }">{{ robot.word }}</td>
            <td :title="robot.program">{{ robot.program }}</td>
            <td>{{ robot.news }}</td>
          </tr>
          <tr v-if="!robots.length">
            <td colspan="5">{{ isConnected ? "no robots; start one in Processes" : "connecting" }}</td>
          </tr>
          <tr v-else-if="!rows.length"><td colspan="5">no robot has "{{ wanted }}"</td></tr>
        </tbody>
      </table>
    </div>`,
  data() {
    return { titles: Object.keys(COLUMNS), wanted: "", by: "Robot", isTurned: false };
  },
  computed: {
    rows() {
      const wanted = this.robots.length > MANY ? this.wanted.trim().toLowerCase() : "";
      const has = ({ name, floor, word, program }) => [name, floor, word, program].join(" ").toLowerCase().includes(wanted);
      const key = COLUMNS[this.by], turned = this.isTurned ? -1 : 1;
      const order = (one, other) => turned * (key === "age" ? (one.age ?? Infinity) - (other.age ?? Infinity) || 0
        : one[key].localeCompare(other[key], undefined, { numeric: true }));
      return this.robots.filter(has).sort(order);
    },
  },
  watch: {
    selected() {
      const index = this.rows.findIndex((robot) => robot.name === this.selected);
      this.$nextTick(() => this.$el.querySelector(`[data-row="${index}"]`)?.scrollIntoView({ block: "nearest" }));
    },
  },
  methods: {
    sort(title) {
      this.isTurned = title === this.by && !this.isTurned;
      this.by = title;
    },
    orderOf(title) {
      return title !== this.by ? "none" : this.isTurned ? "descending" : "ascending";
    },
    key(event, index) {
      const step = { ArrowDown: 1, ArrowUp: -1, Enter: 0, " ": 0 }[event.key];
      if (step === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      const row = this.$el.querySelector(`[data-row="${index + step}"]`);
      if (!row) return;
      row.focus();
      this.$emit("select", this.rows[index + step].name, event.shiftKey);
    },
  },
};
