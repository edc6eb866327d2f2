// A mission's report as tables, and as a file.
import { download } from "/static/download.js";

export const MissionReport = {
  props: { report: Object },
  template: `
    <div class="mission-report">
      <div class="console-actions"><q-btn dense no-caps outline icon="download" label="Download JSON"
          @click="download" /></div>
      <dl class="console-facts">
        <template v-for="([name, value], index) in facts" :key="index"><dt>{{ name }}</dt><dd>{{ value }}</dd></template></dl>
      <details><summary>more</summary><dl class="console-facts">
        <template v-for="([name, value], index) in details" :key="index"><dt>{{ name }}</dt><dd>{{ value }}</dd></template>
        </dl></details>
      <table v-if="report.phases?.length" class="console-table"><caption>Phases</caption>
        <thead><tr><th>phase</th><th>from</th><th>duration</th><th>waited for</th><th>skew at its
          start</th></tr></thead>
        <tbody><tr v-for="phase in report.phases"><td
            :title="phase.name">{{ phase.name }}</td><td>{{ seconds(phase.began_s) }}</td><td>{{
              seconds(duration(phase)) }}</td>
          <td :title="phase.waited_for">{{ phase.waited_for }}</td><td>{{ phase.skew_ms == null ? '' :
            phase.skew_ms.toFixed(1) + ' ms' }}</td></tr></tbody></table>
      <table v-if="latencies.length" class="console-table"><caption>Latency of messages to the leader</caption>
        <thead><tr><th>from sub-network</th><th>messages</th><th>median</th><th>p99</th><th>max</th></tr></thead>
        <tbody><tr v-for="[channel, row] in latencies" :key="channel"><td
            :title="channel">{{ channel }}</td><td>{{ row.count }}</td>
          <td>{{ ms(row.median) }}</td><td>{{ ms(row.p99) }}</td><td>{{ ms(row.max) }}</td></tr></tbody></table>
      <details v-if="report.events?.length"><summary>{{ report.events.length }} of {{ report.events_in_all ??
        report.events.length }} messages that the leader received</summary>
        <table class="console-table">
          <thead><tr><th>at</th><th>type</th><th>from</th><th>sub-network</th><th>latency</th></tr></thead>
          <tbody><tr v-for="event in report.events"><td>{{ seconds(event.at_s) }}</td><td
              :title="event.type">{{ event.type }}</td><td :title="event.source">{{ event.source }}</td>
            <td :title="event.origin">{{ event.origin }}</td><td>{{ ms(event.latency_ms)
              }}</td></tr></tbody></table></details>
    </div>`,
  computed: {
    facts() {
      const { report } = this;
      const rows = [["result", report.result], ["took", this.seconds(report.seconds)]];
      if (report.reason) rows.push(["reason", report.reason]);
      for (const [robot, role] of Object.entries(report.robots ?? {})) rows.push([role || "member", robot]);
      return rows;
    },
    details() {
      const { report } = this, rows = [["identity", report.mission]];
      if (report.farthest_grip_m != null) rows.push(["grip from the hand at most",
        `${(1000 * report.farthest_grip_m).toFixed(1)} mm`]);
      if (report.tick_skew_ms) rows.push(["skew between carriers",
        `median ${this.ms(report.tick_skew_ms.median)}, at most ${this.ms(report.tick_skew_ms.max)}`]);
      for (const [robot, clock] of Object.entries(report.clocks ?? {})) {
        rows.push([`clock of ${robot}`,
          `${clock.offset_ms.toFixed(2)} ms ahead, delay ${clock.delay_ms.toFixed(2)} ms`]);
      }
      return rows;
    },
    latencies() {
      return Object.entries(this.report.latency_ms ?? {}).sort();
    },
  },
  methods: {
    seconds: (value) => (Number.isFinite(value) ? `${value.toFixed(1)} s` : ""),
    ms: (value) => (Number.isFinite(value) ? `${value.toFixed(1)} ms` : ""),
    duration(phase) {
      return Math.max(...Object.values(phase.done_s), phase.began_s) - phase.began_s;
    },
    download() {
      const name = `${(this.report.mission ?? "mission").slice(0, 80)}.json`;
      download(name, JSON.stringify(this.report, null, 2), "application/json");
    },
  },
};
