// The form that starts a mission: the object is chosen on the map, its ghost is dragged to the goal, and the form says
// before the start which robots would come, or why it is not possible.
import { titleOf } from "/static/icon_looks.js";
import { attempt, call, live } from "/static/live.js";
import { movables } from "/static/movable_objects.js";
import { partyText } from "/static/mission_words.js";
import { Schema } from "/static/program_model.js";
import { unplaced } from "/static/segments.js";
import { sharedView } from "/static/shared_view.js";
import { TargetMap } from "/static/target_map.js";

// The icons of missions; their parameters come from the schema of programs.
const COOPERATIVE = ["move_table", "hand_over"];
const ROBOTS = ["taker", "giver"];
const OBJECTS = ["table", "object"];
// Interval between requests for leaders, and time from the last change to the check [ms].
const LEADERS_MS = 3000, CHECK_MS = 300;
const NOWHERE = { floor: "", x: null, y: null, heading: 0 };

export const MissionStart = {
  components: { TargetMap },
  emits: ["started"],
  template: `
    <form class="mission-start" @submit.prevent="start" aria-label="Start a mission">
      <h2 class="console-heading">Start a mission</h2>
      <label class="map-field"><span>kind</span><select :value="kind" @change="chooseKind($event.target.value)"><option
          v-for="each in kinds" :key="each" :value="each">{{ titleOf(each) }}</option></select></label>
      <label class="map-field"><span>leader</span><select v-model="leader">
        <option value="" :disabled="!place">{{ leaders === null ? 'asking the robots' : !leaders.length ? 'no robots'
          : place ? 'the nearest free robot' : 'choose a robot' }}</option>
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
          <select v-if="place" :value="values[parameter.name]" @change="chooseObject($event.target.value)">
            <option value="" disabled>{{ objects.length ? 'choose an object' : isKnown
              ? 'no movable objects on the map' : 'loading the map' }}</option>
            <option v-for="each in objects" :key="each.floor + each.name"
                :value="each.name">{{ each.name }} ({{ each.floor }})</option></select>
          <input v-else v-model="values[parameter.name]" maxlength="200"></label>
      </template>
      <details v-if="others.length" class="mission-more"><summary>more</summary>
        <label v-for="parameter in others" :key="parameter.name"
            class="map-field"><span>{{ parameter.name.replaceAll('_', ' ') }}</span><input
            v-model="values[parameter.name]" maxlength="200"></label></details>
      <template v-if="place">
        <target-map :target="target" :outline="outline" :objects="objects.map(({ name }) => name)" :verdict="verdict"
            :coming="coming" :robot-floor="firstFloor" @pick="pick" @choose="chooseObject"></target-map>
        <div class="mission-pose"><label v-for="[key, title, step] in pose" :key="key">{{ title }} <input
            type="number" :step="step" :value="draft[key] ?? shown(key)"
            @input="draft[key] = $event.target.value" @change="setPose(key, $event.target)"></label></div>
      </template>
      <p class="mission-verdict" :class="'is-' + verdict" role="status">{{ text }}</p>
      <p v-if="problem" class="map-note" role="alert">{{ problem }}</p>
      <div class="console-actions"><q-btn dense no-caps color="primary" icon="play_arrow" type="submit"
          :label="verdict === 'bad' ? 'Start anyway' : 'Start'" :outline="verdict === 'bad'" :loading="isStarting"
          :disable="Boolean(missing)" /></div>
    </form>`,
  data() {
    return {
      schema: null, kinds: [], kind: "", leader: "", leaders: null, values: {}, objects: [], isKnown: false,
      firstFloor: sharedView.floor, free: "", target: NOWHERE, party: null, problem: "", isStarting: false,
      pose: [["x", "x m", 0.05], ["y", "y m", 0.05], ["heading", "heading \u00b0", 15]],
      draft: {}, // what is being typed; news must not replace it
    };
  },
  computed: {
    all() {
      return this.kind ? this.schema.parameters(this.schema.icons.get(this.kind)) : [];
    },
    place() {
      return this.all.find(({ properties }) => properties?.floor && properties.x && properties.y);
    },
    parameters() {
      return this.all.filter((parameter) => this.isRobot(parameter) || this.isObject(parameter));
    },
    others() {
      return this.all.filter((parameter) => parameter !== this.place && !this.parameters.includes(parameter));
    },
    object() {
      return this.objects.find(({ name }) => name === (this.values.table || this.values.object));
    },
    outline() {
      return this.object && unplaced(this.object.polygon, this.object);
    },
    missing() {
      if (!this.kind) return "loading";
      if (!this.place && !this.leader) return "choose a leader";
      const lacking = this.all.find(({ name, isRequired }) => isRequired && name !== this.place?.name
        && !this.values[name]);
      if (lacking) return `choose: ${this.isObject(lacking) ? "object" : lacking.name}`;
      return this.place && (this.target.x === null || this.target.y === null) ? "drag the object to its goal" : "";
    },
    // What is to be started, as the operations have it; null while something is missing.
    wanted() {
      if (this.missing) return null;
      const values = Object.entries(this.values).filter(([, value]) => value !== "").map(([name, value]) => {
        const isNumber = ["number", "integer"].includes(this.all.find((each) => each.name === name)?.type);
        return [name, isNumber ? Number(value) : value];
      });
      const target = this.place ? { [this.place.name]: { ...this.target } } : {};
      return { leader: this.leader, icon: { icon: this.kind, ...Object.fromEntries(values), ...target } };
    },
    verdict() {
      return !this.party || this.party.problem ? "" : this.party.reason ? "bad" : "good";
    },
    coming() {
      return this.verdict === "good" ? this.party.robots : [];
    },
    text() {
      if (this.missing) return this.missing;
      if (!this.party) return "asking who would come";
      return this.party.problem ?? (this.verdict === "bad" ? `\u2717 ${this.party.reason}`
        : `\u2713 ${partyText(this.party)}`);
    },
  },
  watch: {
    wanted() {
      this.party = null;
      this.checkSoon();
    },
  },
  mounted() {
    this.unlisten = live.listen((kind) => this.receive(kind));
    this.loadSchema();
    this.askLeaders();
    this.receive("connection");
  },
  unmounted() {
    this.isClosed = true;
    this.unlisten();
    clearTimeout(this.timer);
    clearTimeout(this.checkTimer);
    clearTimeout(this.schemaTimer);
  },
  methods: {
    titleOf,
    isRobot: ({ name }) => ROBOTS.includes(name),
    isObject: ({ name }) => OBJECTS.includes(name),
    async loadSchema() {
      try {
        const { schema } = await call("program_schema");
        this.schema = new Schema(schema);
        this.kinds = COOPERATIVE.filter((icon) => this.schema.icons.has(icon));
        this.chooseKind(this.kinds[0] ?? "");
      } catch (error) {
        this.problem = error.message;
        if (!this.isClosed) this.schemaTimer = setTimeout(() => this.loadSchema(), LEADERS_MS);
      }
    },
    async askLeaders() {
      try {
        const leaders = await call("leaders");
        leaders.sort((a, b) => b.free - a.free || a.robot.localeCompare(b.robot));
        const free = leaders.filter((each) => each.free).map((each) => each.robot).join("\n");
        this.leaders = leaders;
        if (!free.split("\n").includes(this.leader)) this.leader = "";
        if (this.party && free !== this.free) this.checkSoon();
        this.free = free;
      } catch {
        // the page's header says that the connection is lost
      }
      if (!this.isClosed) this.timer = setTimeout(() => this.askLeaders(), LEADERS_MS);
    },
    receive(kind) {
      if (kind !== "connection" && kind !== "plan") return;
      this.objects = movables(live.names);
      this.isKnown = live.isKnown && live.names.every((floor) => live.plan(floor));
    },
    chooseKind(kind) {
      this.kind = kind;
      this.values = Object.fromEntries(this.all.map(({ name }) => [name, ""]));
    },
    // An object begins where it stands.
    chooseObject(name) {
      if (name === this.object?.name) return;
      this.values[this.parameters.find(this.isObject).name] = name;
      const { floor, heading } = this.object;
      this.target = { ...NOWHERE, floor, heading };
    },
    // Fill the form with the icon of an earlier mission.
    fill({ icon, ...members }) {
      this.chooseKind(icon);
      this.target = this.place ? members[this.place.name] ?? NOWHERE : NOWHERE;
      for (const name of Object.keys(this.values)) if (name !== this.place?.name) this.values[name] = members[name] ?? "";
    },
    pick(values) {
      this.target = { ...this.target, ...values };
    },
    shown(key) {
      const value = this.target[key];
      if (value === null) return "";
      return Number(key === "heading" ? ((value * 180) / Math.PI).toFixed(1) : value.toFixed(2));
    },
    setPose(key, input) {
      const value = input.valueAsNumber;
      delete this.draft[key];
      if (!Number.isFinite(value)) input.value = this.shown(key);
      else this.pick({ [key]: key === "heading" ? (value * Math.PI) / 180 : value });
    },

    // ---- check ----

    checkSoon() {
      clearTimeout(this.checkTimer);
      if (this.wanted) this.checkTimer = setTimeout(() => this.check(this.wanted), CHECK_MS);
    },
    async check(wanted) {
      const party = await call("mission_party", wanted).catch((error) => ({ problem: `not checked: ${error.message}` }));
      if (wanted === this.wanted) this.party = party;
    },

    // ---- start ----

    async start() {
      if (this.missing) return;
      await attempt(this, async () => {
        this.$emit("started", await call("start_mission", this.wanted));
        this.fill({ icon: this.kind });
      }, { busy: "isStarting" });
    },
  },
};
