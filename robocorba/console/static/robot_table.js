// All robots that were seen, also those that are lost; a row selects, arrow keys go to the next one.
export default {
  // note: said above the table.
  props: { robots: Array, selected: String, isConnected: Boolean, note: String },
  emits: ["select"],
  template: `
    <div class="robot-table">
      <p v-if="note" class="panel-note" role="status">{{ note }}</p>
      <table class="console-table">
        <thead><tr><th>Robot</th><th>Floor</th><th>State</th><th>Program</th><th>News</th></tr></thead>
        <tbody>
          <tr v-for="(robot, index) in robots" :key="robot.name" :data-row="index" tabindex="0"
              :class="{ 'is-lost': robot.isLost }" :aria-selected="robot.name === selected"
              @click="$emit('select', robot.name)" @keydown="key($event, index)">
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
        </tbody>
      </table>
    </div>`,
  watch: {
    selected() {
      const index = this.robots.findIndex((robot) => robot.name === this.selected);
      this.$nextTick(() => this.$el.querySelector(`[data-row="${index}"]`)?.scrollIntoView({ block: "nearest" }));
    },
  },
  methods: {
    key(event, index) {
      const step = { ArrowDown: 1, ArrowUp: -1, Enter: 0, " ": 0 }[event.key];
      if (step === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      const row = this.$el.querySelector(`[data-row="${index + step}"]`);
      if (!row) return;
      row.focus();
      this.$emit("select", this.robots[index + step].name);
    },
  },
};
