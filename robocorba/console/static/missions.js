// The missions page: all missions of the building, their phases over time, abort and report, and a form to start one.
import { call, live } from "/static/live.js";
import { MissionGantt } from "/static/mission_gantt.js";
import { MissionReport } from "/static/mission_report.js";
import { MissionStart } from "/static/mission_start.js";
import { missionTitle } from "/static/mission_words.js";
import { rememberView } from "/static/shared_view.js";
import { durationText } from "/static/texts.js";

// Interval between reports of a running mission, for the bars of its robots [ms].
const REPORT_MS = 2000;
// The mission that the address names.
const LINKED = new URLSearchParams(location.search).get("mission") ?? "";
// Results with a sign, so that they are told apart without colours.
const SIGNS = { running: "\u25b6", aborting: "\u25a0", done: "\u2713", aborted: "\u25a0", failed: "\u2717" };

export default {
  components: { MissionGantt, MissionReport, MissionStart },
  template: `
    <div class="console-split map-page missions-page">
      <section class="missions-main">
        <div class="missions-list">
          <table class="console-table">
            <thead><tr><th>State</th><th>Mission</th><th>Leader</th><th>Phase</th><th>Took</th></tr></thead>
            <tbody>
              <tr v-for="row in rows" :key="row.name" tabindex="0" :aria-selected="row.name === selected"
                  :class="'is-' + row.state"
                  @click="select(row.name)" @keydown.enter="select(row.name)" @keydown.space.prevent="select(row.name)">
                <td><span class="mission-state" :class="'is-' + row.state">{{ row.sign }} {{ row.state }}</span></td>
                <td :title="row.title">{{ row.title }}</td><td :title="row.leader">{{ row.leader }}</td>
                <td :title="row.phase">{{ row.phase }}</td><td>{{ row.took }}</td></tr>
            </tbody>
          </table>
          <p v-if="!rows.length" class="console-message">{{ empty }}</p>
          <p v-else-if="problem" class="map-note"
              role="alert">{{ problem }}; the missions are shown as they were last known</p>
        </div>
        <div v-if="mission" class="missions-detail" :aria-label="chosen.title">
          <h2 class="missions-title"><span>{{ chosen.title }}</span>
            <small class="mission-state" :class="'is-' + chosen.state">{{ chosen.sign }} {{ chosen.state }}</small></h2>
          <p v-if="mission.reason || standing" class="missions-reason">{{ mission.reason }}
            <span v-if="standing" class="missions-standing">{{ standing }}</span></p>
          <p v-if="notes[mission.name]" class="map-note" role="alert">{{ notes[mission.name] }}</p>
          <div class="console-actions">
            <q-btn v-if="mission.result === 'running'" dense no-caps color="negative" icon="stop"
                :disable="chosen.state === 'aborting'"
                   :label="chosen.state === 'aborting' ? 'Aborting' : 'Abort'" :loading="isOrdering" @click="abort" />
            <q-btn v-if="mission.result !== 'running'" dense no-caps outline icon="summarize"
                :label="isReportShown ? 'Hide report' : 'Report'"
                   :aria-expanded="isReportShown" @click="toggleReport" />
            <q-btn v-if="mission.result !== 'running'" dense no-caps outline icon="replay" label="Again"
                title="Fill the form with what this mission was to do" :loading="isOrdering" @click="again" />
            <span class="missions-members">{{ memberText }}</span></div>
          <mission-gantt v-if="mission.phases.length" :mission="mission" :report="report" :now="now"></mission-gantt>
          <p v-else class="map-none">No phase has begun yet.</p>
          <template v-if="isReportShown">
            <p v-if="reportProblem" class="map-note" role="alert">{{ reportProblem }}</p>
            <p v-else-if="!report" class="map-none">loading the report</p>
            <mission-report v-else :report="report"></mission-report>
          </template>
        </div>
      </section>
      <aside class="console-side" aria-label="Start a mission"><mission-start
          ref="start" @started="select"></mission-start></aside>
    </div>`,
  data() {
    return {
      rows: [], selected: LINKED, mission: null, now: 0, problem: "", empty: "connecting", aborting: {}, notes: {},
        isOrdering: false,
      standing: "", report: null, reportProblem: "", reportTurn: 0, isReportShown: false,
    };
  },
  computed: {
    chosen() {
      return this.rows.find((row) => row.name === this.selected) ?? { state: "", sign: "", title: "" };
    },
    memberText() {
      const { members, leader } = this.mission;
      if (!members.length) return this.mission.ended ? `led by ${leader}` : `led by ${leader}; looking for robots`;
      return members.map(({ robot,
        role }) => `${robot}${robot === leader ? " leads" : ""}${role && role !== "leader" ? ` (${role})` : ""}`).join(", ");
    },
  },
  mounted() {
    live.want(this, { floors: [], missions: true });
    this.unlisten = live.listen((kind) => ["missions", "connection"].includes(kind) && this.update());
    this.timer = setInterval(() => this.update(), 1000);
    this.reportTimer = setInterval(() => this.mission?.result === "running" && this.loadReport(), REPORT_MS);
    this.update();
  },
  unmounted() {
    this.unlisten();
    live.want(this);
    clearInterval(this.timer);
    clearInterval(this.reportTimer);
  },
  methods: {
    update() {
      this.now = live.serverNow();
      this.problem = live.isConnected ? live.problems.missions ?? "" : "the console does not answer; reconnecting";
      const known = [...live.missions.values()];
      this.takeOutcomes();
      known.sort((a, b) => (a.result === "running" ? 0 : 1) - (b.result === "running" ? 0 : 1) || b.begun - a.begun);
      this.rows = known.map((mission) => this.rowOf(mission));
      if (!live.isConnected) this.empty = "the console does not answer; reconnecting";
      else if (live.missionsKnown) this.empty = this.problem
        || "No missions yet. Start one beside: robots then work together, such as carry a table.";
      else this.empty = this.problem || "loading the missions";
      const mission = live.missions.get(this.selected) ?? null;
      const hasOtherResult = mission && mission.result !== this.mission?.result;
      this.mission = mission;
      if (hasOtherResult) {
        this.loadReport();
        this.findObject(mission);
      }
      const isOld = live.missionsKnown && !mission && this.selected === LINKED; // none, or one that is not kept any more
      if (isOld && this.rows.length) this.select(this.rows[0].name);
    },
    rowOf(mission) {
      const isRunning = mission.result === "running";
      const state = isRunning && this.aborting[mission.name] ? "aborting" : mission.result;
      const last = mission.phases[mission.phases.length - 1];
      const of = mission.phases_in_all
        ? ` (${mission.phases.length} of ${Math.max(mission.phases_in_all, mission.phases.length)})` : "";
      const phase = isRunning && last ? `${last.name}${of}${last.waited_for ? `, waits for ${last.waited_for}` : ""}`
        : mission.reason || last?.name || "";
      return {
        name: mission.name, title: missionTitle(mission), leader: mission.leader, state, sign: SIGNS[state] ?? "", phase,
        took: durationText((mission.ended || this.now) - mission.begun),
      };
    },
    // What became of the missions that were to be aborted.
    takeOutcomes() {
      for (const name of Object.keys(this.aborting)) {
        const result = live.missions.get(name)?.result;
        if (!result || result === "running") continue;
        delete this.aborting[name];
        if (result === "done") this.notes[name] = "It was done before the abort took effect.";
      }
    },
    select(name) {
      if (name === this.selected && this.mission) return;
      this.selected = name;
      rememberView({}, { mission: name });
      this.mission = this.report = null;
      this.standing = "";
      this.reportProblem = "";
      this.isReportShown = false;
      this.update();
    },
    toggleReport() {
      this.isReportShown = !this.isReportShown;
      if (this.isReportShown) this.loadReport();
    },
    async loadReport() {
      const turn = ++this.reportTurn;
      const [report, problem] = await call("mission_report", { name: this.selected })
        .then((found) => [found, ""], ({ message }) => [this.report, message]);
      if (turn === this.reportTurn) [this.report, this.reportProblem] = [report, problem];
    },
    abort() {
      return this.order("Not aborted: ", async (name) => {
        await call("abort_mission", { name });
        this.aborting[name] = true;
        this.update();
      });
    },
    again() {
      return this.order("", async (name) => this.$refs.start.fill(await call("mission_icon", { name })));
    },
    async order(failure, work) {
      const { name } = this.mission;
      this.isOrdering = true;
      delete this.notes[name];
      await work(name).catch(({ message }) => { this.notes[name] = failure + message; });
      this.isOrdering = false;
    },
    // Where the object of a mission is that did not bring it to its goal.
    async findObject({ name, about, result }) {
      if (!about || !["aborted", "failed"].includes(result)) return;
      const place = await call("object_place", { name: about }).catch(() => null);
      if (!place || name !== this.selected) return;
      this.standing = `${about} stands at ${place.floor} (${place.x.toFixed(2)}, ${place.y.toFixed(2)}) now.`;
    },
  },
};
