// The phases of a mission as bars over time: who worked, and who waited for which robot.

// A phase of the live row belongs to one of the report if both began at the same time, within this tolerance [s].
const SAME_S = 2;

export const MissionGantt = {
  props: { mission: Object, report: Object, now: Number },
  template: `
    <div class="gantt" role="table" :aria-label="'Phases of ' + mission.name">
      <div class="gantt-row gantt-axis" role="row"><span role="columnheader">phase</span>
        <span class="gantt-chart" role="columnheader"><i v-for="tick in ticks"
            :style="{ left: tick.left }">{{ tick.text }}</i></span>
        <span role="columnheader">waits for</span></div>
      <div v-for="(phase, n) in rows" :key="n" class="gantt-row" :class="{ 'is-running': phase.isRunning }" role="row">
        <span class="gantt-name" role="cell" :title="phase.name">{{ phase.name }}</span>
        <span class="gantt-chart" role="cell" :aria-label="phase.words">
          <b class="gantt-bar" :style="phase.bar"></b>
          <span v-for="lane in phase.lanes" :key="lane.robot" class="gantt-lane" :title="lane.words">
            <b class="gantt-work" :style="lane.work"></b><b class="gantt-wait" :style="lane.wait"></b>
            <small :style="{ left: lane.labelLeft }">{{ lane.robot }}</small></span>
        </span>
        <span class="gantt-waited" role="cell" :title="phase.waited">{{ phase.waited }}</span></div>
      <div v-if="left > 0" class="gantt-row gantt-next"><span>{{ left }} more</span><span></span><span></span></div>
      <p class="gantt-legend"><b class="gantt-work"></b> works <b class="gantt-wait"></b> waits for the others</p>
    </div>`,
  computed: {
    begun() {
      return this.mission.begun;
    },
    length() {
      return Math.max((this.mission.ended || this.now) - this.begun, 1);
    },
    left() {
      return this.mission.ended ? 0 : this.mission.phases_in_all - this.mission.phases.length;
    },
    ticks() {
      const step = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600].find((each) => this.length / each <= 6) ?? 7200;
      const count = Math.floor(this.length / step) + 1;
      return Array.from({ length: Math.min(count, 20) }, (_, n) => ({ left: this.percent(n * step),
        text: `${n * step} s` }));
    },
    rows() {
      return this.mission.phases.map((phase) => this.row(phase));
    },
  },
  methods: {
    percent(seconds) {
      return `${Math.min(Math.max((100 * seconds) / this.length, 0), 100).toFixed(2)}%`;
    },
    span(from, to) {
      return { left: this.percent(from), width: this.percent(Math.max(to - from, 0)) };
    },
    row(phase) {
      const from = phase.begun - this.begun;
      const isRunning = !phase.ended && !this.mission.ended;
      const to = (phase.ended || this.mission.ended || this.now) - this.begun;
      const seconds = `${(to - from).toFixed(1)} s`;
      const waited = phase.waited_for ? `${phase.waited_for} (${seconds})` : seconds;
      const words = `${phase.name}: from ${from.toFixed(1)} s, ${seconds}${phase.waited_for ? `,
        waits for ${phase.waited_for}` : ""}`;
      return { name: phase.name, isRunning, waited, words, bar: this.span(from, to), lanes: this.lanes(phase, from,
        to) };
    },
    lanes(phase, from, to) {
      // The report counts from its own beginning, which is after the mission's.
      const shift = this.report?.began ? this.report.began - this.begun : 0;
      const known = this.report?.phases?.find(({ name, began_s }) => name === phase.name && Math.abs(began_s
        + shift - from) < SAME_S);
      if (!known) return [];
      return Object.entries(known.started_s).sort().map(([robot, started_s]) => {
        const started = Math.max(started_s + shift, from);
        const done = robot in known.done_s ? known.done_s[robot] + shift : to;
        const waits = Math.max(to - done, 0).toFixed(1);
        const words = `${robot}: ${started.toFixed(1)} to ${done.toFixed(1)} s, then waits ${waits} s`;
        return { robot, words, work: this.span(started, done), wait: this.span(done, to),
          labelLeft: this.percent(from) };
      });
    },
  },
};
