// The graphic programming agent: build a program from icons, check it, run it on the virtual robot, upload it to the actual.
import { FloorCanvas } from "/static/floor_canvas.js";
import { IconForm } from "/static/icon_form.js";
import { IconList, LOOKS } from "/static/icon_list.js";
import { call, live } from "/static/live.js";
import { missing, newNode, nodeOf, plainOf, ProgramModel, Schema } from "/static/program_model.js";

const GROUPS = [
  ["Base", ["mbase_path", "mbase_to", "mbase_by", "mbase_velocity"]],
  ["Arms and body", ["mhand_posture", "mhand_pose", "mhand_offset", "mhand_joints", "lumbar", "gripper"]],
  ["Control", ["wait", "wait_until", "stop_if_closer", "repeat", "branch"]],
  ["Others", ["say", "move_table", "hand_over"]],
];
// The program is checked this long after the last change [ms], and a running one is asked for its icons so often.
const CHECK_MS = 500;
const POLL_MS = 250;
const STORED = "robocorba-program";

export default {
  components: { IconForm, IconList },
  template: `
    <div class="program-page">
      <div class="program-bar">
        <input class="program-name" v-model.lazy="name" aria-label="Name of the program" maxlength="200">
        <q-btn flat dense round icon="undo" aria-label="Undo" :disable="!canUndo" @click="undo" />
        <q-btn flat dense round icon="redo" aria-label="Redo" :disable="!canRedo" @click="redo" />
        <q-btn flat dense round icon="note_add" aria-label="New program" @click="clear" />
        <q-btn flat dense round icon="file_open" aria-label="Open a program file" @click="$refs.file.click()" />
        <q-btn flat dense round icon="download" aria-label="Save as a file" @click="save" />
        <input ref="file" type="file" accept=".json,application/json" hidden @change="open">
        <span class="program-verdict" :class="{ 'is-problem': count }" role="status">{{ verdict }}</span>
        <label>robot <select v-model="robot" aria-label="Robot"><option v-for="each in robots" :key="each">{{ each }}</option></select></label>
        <span class="program-adaptor">{{ adaptor }}</span>
        <q-btn dense no-caps color="primary" icon="play_arrow" label="Run" :disable="!canRun" @click="run(false)" />
        <q-btn dense no-caps outline icon="skip_next" label="Step" :disable="!robot || (!canRun && condition !== 'PAUSED')" @click="step" />
        <q-btn dense no-caps outline :icon="condition === 'PAUSED' ? 'play_arrow' : 'pause'" :disable="!isActive"
               :label="condition === 'PAUSED' ? 'Resume' : 'Pause'" @click="pause" />
        <q-btn dense no-caps outline icon="stop" label="Abort" :disable="!isActive" @click="order('abort_program')" />
        <q-btn dense no-caps outline icon="upload" label="Upload" :disable="!canRun" @click="isUploading = true" />
      </div>
      <div class="program-columns">
        <aside class="program-palette" aria-label="Icons">
          <template v-for="[title, icons] in groups" :key="title"><h2 class="console-heading">{{ title }}</h2>
            <button v-for="icon in icons" :key="icon" class="palette-icon" draggable="true" :title="description(icon)"
                    @click="append(icon)" @dragstart="dragNew($event, icon)" @dragend="drop()">
              <q-icon :name="looks[icon]" size="20px" /> {{ icon }}</button></template>
        </aside>
        <section class="program-list" aria-label="Program" @click="select(null)">
          <icon-list v-if="schema" :list="model.icons" :parent-id="null" list-name="icons" :editor="editor"></icon-list>
          <div v-else class="console-message">{{ message }}</div>
        </section>
        <aside class="program-side">
          <template v-if="node">
            <icon-form :schema="schema" :node="node" :names="names" @change="change"></icon-form>
            <div class="console-actions">
              <q-btn v-if="isPlace" dense no-caps outline icon="my_location" label="Where the robot is" @click="takePose" />
              <q-btn v-if="isPosture" dense no-caps outline icon="accessibility_new" label="As the robot stands" @click="takeJoints" />
              <q-btn dense no-caps outline icon="content_copy" label="Copy" @click="copyNode" />
              <q-btn dense no-caps outline icon="delete" label="Remove" @click="remove(node.id)" />
              <q-btn v-if="isTop" dense no-caps outline icon="start" label="Run from here" :disable="!canRun" @click="run(false, node.id)" />
            </div>
            <ul v-if="problems(node).length" class="program-problems"><li v-for="problem in problems(node)" :key="problem">{{ problem }}</li></ul>
          </template>
          <div v-else class="console-message">Take icons from the left, or select one to see its parameters.</div>
          <div v-show="isPlace" class="program-map"><canvas ref="canvas" tabindex="0" aria-label="Pick the target on the map"></canvas></div>
          <q-tabs v-model="tab" dense no-caps align="left"><q-tab name="json" label="JSON" /><q-tab name="python" label="Python" /></q-tabs>
          <pre class="program-text" tabindex="0">{{ tab === "json" ? jsonText : pythonText }}</pre>
        </aside>
      </div>
      <q-dialog v-model="isUploading"><q-card style="min-width: 340px"><q-card-section>
        <div class="text-h6">Upload to the actual robot</div>
        <p>The program <b>{{ name }}</b> will run on the robot <b>{{ robot }}</b>.</p>
        <label>adaptor <select v-model="wantedAdaptor" aria-label="Adaptor"><option v-for="each in adaptors" :key="each">{{ each }}</option></select></label>
        <label style="display: block; margin-top: 8px">its arguments <input v-model="adaptorArguments" aria-label="Arguments of the adaptor"></label>
        </q-card-section><q-card-actions align="right"><q-btn flat no-caps label="Cancel" v-close-popup />
        <q-btn color="negative" no-caps :label="'Run on ' + robot + ' by ' + wantedAdaptor" :disable="!wantedAdaptor" @click="upload" v-close-popup />
        </q-card-actions></q-card></q-dialog>
    </div>`,
  data() {
    return {
      groups: GROUPS, looks: LOOKS, model: new ProgramModel(), schema: null, message: "loading the icons",
      selectedId: null, target: null, findings: [], runningId: null, doneIds: new Set(), robots: [], robot: "",
      condition: "", adaptor: "", adaptors: [], wantedAdaptor: "", adaptorArguments: "", isUploading: false, tab: "json",
      pythonText: "", names: {}, change_: 0, isChecked: false,
    };
  },
  computed: {
    editor() {
      return {
        selectedId: this.selectedId, target: this.target, runningId: this.runningId, doneIds: this.doneIds,
        problems: (node) => this.problems(node), select: (id) => this.select(id), key: (event, node) => this.key(event, node),
        drag: (event, node) => this.dragNode(event, node), over: (...place) => this.over(...place), drop: (event) => this.drop(event),
      };
    },
    name: {
      get() { return this.model.name; },
      set(name) { this.model.remember("name"); this.model.name = name; this.changed(); },
    },
    node() { return this.selectedId === null ? null : this.model.find(this.selectedId)?.node; },
    isTop() { return this.node && this.model.icons.some((node) => node.id === this.node.id); },
    isPlace() { return Boolean(this.node && ["mbase_path", "mbase_to", "move_table"].includes(this.node.icon)); },
    isPosture() { return Boolean(this.node && ["mhand_joints", "lumbar", "mhand_pose"].includes(this.node.icon)); },
    jsonText() { return JSON.stringify(this.model.plain(), null, 2); },
    incomplete() { return [...this.model.walk()].filter(({ node }) => missing(this.schema, node).length).length; },
    errors() { return this.findings.filter((finding) => finding.kind === "PROGRAM_ERROR"); },
    count() { return this.schema ? this.incomplete + this.errors.length : 0; },
    verdict() {
      if (!this.model.icons.length) return "";
      if (this.schema && this.incomplete) return `${this.incomplete} icons are incomplete`;
      if (this.errors.length) return `${this.errors.length} errors`;
      return this.isChecked ? "checked" : "checking";
    },
    canUndo() { return this.change_ >= 0 && this.model.done.length > 0; },
    canRedo() { return this.change_ >= 0 && this.model.undone.length > 0; },
    isActive() { return this.condition === "RUNNING" || this.condition === "PAUSED"; },
    canRun() { return Boolean(this.robot && this.model.icons.length && !this.count && this.condition === "IDLE"); },
  },
  async mounted() {
    const stored = localStorage.getItem(STORED);
    if (stored) try { Object.assign(this.model, { name: JSON.parse(stored).name, icons: JSON.parse(stored).icons.map(nodeOf) }); } catch { /* of an older version */ }
    this.unlisten = live.listen((kind, name) => this.news(kind, name));
    this.canvas = new FloorCanvas(this.$refs.canvas, { pointer: (...news) => this.pick(...news) });
    this.canvas.overlays = [{ above: (context, canvas) => this.drawTarget(context, canvas) }];
    this.poll = setInterval(() => this.followRun(), POLL_MS);
    this.onKey = (event) => this.pageKey(event);
    window.addEventListener("keydown", this.onKey);
    try {
      this.schema = new Schema(await call("program_schema"));
      this.changed();
    } catch (error) {
      this.message = error.message;
    }
    this.news("state");
  },
  unmounted() {
    this.unlisten();
    live.want(this);
    clearInterval(this.poll);
    clearTimeout(this.checkTimer);
    window.removeEventListener("keydown", this.onKey);
    this.canvas.close();
  },
  watch: {
    robot() {
      this.findings = [];
      this.news("state");
      this.check();
      this.loadAdaptors();
    },
    selectedId() { this.showMap(); },
  },
  methods: {
    news(kind, name) {
      if (kind === "state" && live.state) {
        this.robots = Object.entries(live.state.robots).filter(([, robot]) => robot.bound).map(([each]) => each);
        if (!this.robots.includes(this.robot)) this.robot = this.robots[0] ?? "";
        const state = live.state.robots[this.robot]?.state;
        this.condition = state?.condition ?? "";
        this.adaptor = state?.adaptor ?? "";
      }
      if (kind === "floor" || kind === "plan" || kind === "connection") this.showMap();
      if (kind === "state" || kind === "connection") this.loadNames();
    },
    loadNames() {
      const objects = live.names.flatMap((floor) => [...live.floor(floor).bodies.values()].filter((body) => body.kind === "object"));
      const names = [...new Set(objects.map((body) => body.name))].sort();
      this.names = { table: names, object: names, taker: this.robots, giver: this.robots };
    },
    description(icon) { return this.schema?.icons.get(icon)?.description ?? ""; },
    // ---- changes ----
    changed() {
      this.change_++;
      this.isChecked = false;
      this.runningId = null;
      this.doneIds = new Set();
      localStorage.setItem(STORED, JSON.stringify(this.model.plain()));
      clearTimeout(this.checkTimer);
      this.checkTimer = setTimeout(() => this.check(), CHECK_MS);
    },
    append(icon) {
      const node = newNode(icon);
      const place = this.selectedId !== null && this.model.find(this.selectedId);
      const body = place && Object.keys(place.node.bodies)[0];
      if (body) this.model.insert(node, place.node.id, body, place.node.bodies[body].length);
      else if (place) this.model.insert(node, place.parent?.id ?? null, this.listName(place), place.index + 1);
      else this.model.insert(node, null, "icons", this.model.icons.length);
      if (!body) this.select(node.id);
      this.changed();
    },
    listName(place) {
      if (!place.parent) return "icons";
      return Object.entries(place.parent.bodies).find(([, list]) => list === place.list)[0];
    },
    change(name, value) {
      this.model.remember(`${this.node.id} ${name}`);
      if (value === undefined) delete this.node.values[name];
      else this.node.values[name] = value;
      this.changed();
    },
    remove(id) {
      this.model.remove(id);
      this.selectedId = null;
      this.changed();
    },
    copyNode() {
      this.selectedId = this.model.copy(this.node.id).id;
      this.changed();
    },
    undo() { this.model.undo(); this.afterStep(); },
    redo() { this.model.redo(); this.afterStep(); },
    afterStep() {
      if (!this.model.find(this.selectedId)) this.selectedId = null;
      this.changed();
    },
    clear() {
      this.model.remember();
      this.model.icons = [];
      this.model.name = "program";
      this.selectedId = null;
      this.changed();
    },
    select(id) { this.selectedId = id; },
    // ---- keyboard ----
    key(event, node) {
      if (event.key === "Delete" || event.key === "Backspace") this.remove(node.id);
      else if (event.altKey && event.key === "ArrowUp") { this.model.shift(node.id, -1); this.changed(); }
      else if (event.altKey && event.key === "ArrowDown") { this.model.shift(node.id, 1); this.changed(); }
      else if (event.key === "ArrowUp" || event.key === "ArrowDown") this.focusNext(node, event.key === "ArrowUp" ? -1 : 1);
      else return;
      event.preventDefault();
      event.stopPropagation();
    },
    focusNext(node, by) {
      const cards = [...this.$el.querySelectorAll(".icon-card")];
      cards[cards.findIndex((card) => Number(card.dataset.id) === node.id) + by]?.focus();
    },
    pageKey(event) {
      if (event.target.closest("input, textarea, select")) return;
      const isCommand = event.ctrlKey || event.metaKey;
      if (isCommand && event.key.toLowerCase() === "z") (event.shiftKey ? this.redo() : this.undo());
      else if (isCommand && event.key.toLowerCase() === "y") this.redo();
      else if (isCommand && event.key.toLowerCase() === "c" && this.node && !String(getSelection())) this.clipboard = plainOf(this.node);
      else if (isCommand && event.key.toLowerCase() === "v" && this.clipboard) {
        const place = this.selectedId !== null && this.model.find(this.selectedId);
        const node = nodeOf(this.clipboard);
        this.model.insert(node, place?.parent?.id ?? null, place ? this.listName(place) : "icons", place ? place.index + 1 : this.model.icons.length);
        this.select(node.id);
        this.changed();
      } else return;
      event.preventDefault();
    },
    // ---- drag and drop ----
    dragNew(event, icon) {
      this.dragged = { icon };
      event.dataTransfer.setData("text/plain", icon);
    },
    dragNode(event, node) {
      this.dragged = { id: node.id };
      event.dataTransfer.setData("text/plain", node.icon);
    },
    over(parentId, name, index) {
      if (this.dragged) this.target = { parentId, name, index };
    },
    drop(event) {
      const { dragged, target } = this;
      this.dragged = this.target = null;
      if (!event || !dragged || !target) return;
      if (dragged.icon) {
        const node = newNode(dragged.icon);
        this.model.insert(node, target.parentId, target.name, target.index);
        this.select(node.id);
      } else if (!this.model.move(dragged.id, target.parentId, target.name, target.index)) {
        return;
      }
      this.changed();
    },
    // ---- map ----
    showMap() {
      if (!this.canvas) return;
      const floor = this.targetFloor();
      live.want(this, { floors: floor && this.isPlace ? [floor] : [] });
      if (!this.isPlace || !floor) return;
      this.canvas.floor = live.floor(floor);
      const plan = live.plan(floor);
      if (plan) this.canvas.setPlan(plan);
      this.canvas.redraw();
    },
    targetValues() { return this.node?.icon === "move_table" ? this.node.values.to ?? {} : this.node?.values ?? {}; },
    targetFloor() {
      const robotFloor = live.state?.robots[this.robot]?.state?.at.floor;
      return this.targetValues().floor || robotFloor || live.names[0];
    },
    pick(kind, event, [x, y]) {
      if (!this.node || !["down", "move", "up"].includes(kind)) return false;
      if (kind === "move" && !this.isPicking) return false;
      this.isPicking = kind !== "up";
      const rounded = (value) => Math.round(value * 100) / 100;
      const values = { x: rounded(x), y: rounded(y) };
      if (this.node.icon !== "mbase_to") values.floor = this.targetFloor();
      this.model.remember(`${this.node.id} target`);
      if (this.node.icon === "move_table") this.node.values.to = { ...this.node.values.to, ...values };
      else Object.assign(this.node.values, values);
      this.changed();
      this.canvas.redraw();
      return true;
    },
    drawTarget(context, canvas) {
      const { x, y, heading } = this.targetValues();
      if (typeof x !== "number" || typeof y !== "number") return;
      const radius = Math.max(canvas.px(7), 0.4);
      context.strokeStyle = canvas.colors.selected;
      context.lineWidth = canvas.px(3);
      context.beginPath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
      context.moveTo(x, y);
      if (typeof heading === "number") context.lineTo(x + radius * Math.cos(heading), y + radius * Math.sin(heading));
      context.stroke();
    },
    takePose() {
      const at = live.state?.robots[this.robot]?.state?.at;
      if (!at) return this.complain("the robot does not report its pose");
      this.model.remember();
      const pose = { floor: at.floor, x: Number(at.x.toFixed(3)), y: Number(at.y.toFixed(3)), heading: Number(at.heading.toFixed(3)) };
      if (this.node.icon === "mbase_to") delete pose.floor;
      if (this.node.icon === "move_table") this.node.values.to = pose;
      else Object.assign(this.node.values, pose);
      this.changed();
      this.showMap();
    },
    takeJoints() {
      const joints = live.joints(this.robot);
      if (!joints) return this.complain("the robot does not report its joints");
      const rounded = (value) => Number(value.toFixed(4));
      this.model.remember();
      const { values } = this.node;
      if (this.node.icon === "lumbar") Object.assign(values, { lower: rounded(joints[14]), upper: rounded(joints[15]) });
      else if (this.node.icon === "mhand_joints") values.joints = joints.slice(values.hand === "right" ? 7 : 0, values.hand === "right" ? 14 : 7).map(rounded);
      else return this.takeHand(values.hand ?? "left");
      this.changed();
    },
    async takeHand(hand) {
      try {
        const pose = await call("hand_pose", { robot: this.robot, hand: hand === "right" ? "right" : "left" });
        Object.assign(this.node.values, pose);
        this.changed();
      } catch (error) {
        this.complain(error.message);
      }
    },
    // ---- check and run ----
    problems(node) {
      const own = missing(this.schema, node).map(({ parameter, reason }) => `${parameter} ${reason}`);
      const found = this.findings.filter((finding) => finding.nodeId === node.id).map(({ parameter, reason }) => (parameter ? `${parameter}: ${reason}` : reason));
      return [...own, ...found];
    },
    async check() {
      if (!this.schema || !this.model.icons.length || this.incomplete) {
        this.findings = [];
        return;
      }
      const number = this.change_;
      try {
        const found = await call("check_program", { robot: this.robot, program: this.jsonText });
        if (number !== this.change_) return;
        this.findings = found.findings.map((finding) => ({ ...finding, nodeId: this.model.at(finding.icon)?.id }));
        this.pythonText = found.python;
        this.isChecked = true;
      } catch (error) {
        this.findings = [{ kind: "PROGRAM_ERROR", icon: "", parameter: "", reason: error.message }];
      }
    },
    async run(isStepping, fromId = null) {
      const plain = this.model.plain();
      this.offset = 0;
      if (fromId !== null) {
        this.offset = this.model.icons.findIndex((node) => node.id === fromId);
        plain.icons = plain.icons.slice(this.offset);
      }
      this.doneIds = new Set();
      await this.order("run_program", { program: JSON.stringify(plain), is_stepping: isStepping });
      this.seen = 0;
      this.isFollowed = true;
    },
    async step() {
      if (this.condition === "PAUSED") await this.order("step_program");
      else await this.run(true);
    },
    async pause() { await this.order(this.condition === "PAUSED" ? "resume_program" : "pause_program"); },
    async followRun() {
      if (!this.isFollowed || this.isAsking) return;
      this.isAsking = true;
      try {
        const { icons, report } = await call("program_progress", { robot: this.robot, first: this.seen });
        for (const begun of icons) {
          const node = this.model.at(this.shifted(begun.icon));
          if (this.runningId !== null) this.doneIds.add(this.runningId);
          this.runningId = node?.id ?? null;
          this.seen = begun.number + 1;
        }
        if (report.result !== "NO_RESULT") this.ended(report);
      } catch (error) {
        this.isFollowed = false;
        this.complain(error.message);
      } finally {
        this.isAsking = false;
      }
    },
    shifted(path) {
      return path.replace(/^icons\[(\d+)\]/, (whole, index) => `icons[${Number(index) + this.offset}]`);
    },
    ended(report) {
      this.isFollowed = false;
      if (report.result === "DONE" && this.runningId !== null) this.doneIds.add(this.runningId);
      if (report.result === "DONE") this.runningId = null;
      const type = { DONE: "positive", ABORTED: "warning", FAILED: "negative" }[report.result];
      const message = `${report.name}: ${report.result.toLowerCase()} after ${report.seconds.toFixed(1)} s${report.reason ? `: ${report.reason}` : ""}`;
      this.$q.notify({ type, message, timeout: report.result === "DONE" ? 5000 : 0, closeBtn: report.result !== "DONE" });
    },
    async loadAdaptors() {
      this.adaptors = this.robot ? await call("adaptors", { robot: this.robot }).catch(() => []) : [];
    },
    async upload() {
      const argv = this.adaptorArguments.trim() ? this.adaptorArguments.trim().split(/\s+/) : [];
      if (await this.order("switch_adaptor", { adaptor: this.wantedAdaptor, arguments: argv })) await this.run(false);
    },
    async order(operation, argument = {}) {
      try {
        await call(operation, { robot: this.robot, ...argument });
        return true;
      } catch (error) {
        this.complain(error.message);
        return false;
      }
    },
    complain(message) { this.$q.notify({ type: "negative", message }); },
    // ---- files ----
    save() {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(new Blob([`${this.jsonText}\n`], { type: "application/json" }));
      link.download = `${this.name.replace(/[^\w.-]+/g, "_") || "program"}.json`;
      link.click();
      URL.revokeObjectURL(link.href);
    },
    async open(event) {
      const [file] = event.target.files;
      event.target.value = "";
      if (!file) return;
      try {
        const plain = JSON.parse(await file.text());
        if (!Array.isArray(plain.icons)) throw new Error("it has no icons");
        const unknown = plain.icons.find((icon) => !this.schema.icons.has(icon.icon));
        if (unknown) throw new Error(`unknown icon ${unknown.icon}`);
        this.model.load({ name: "program", ...plain });
        this.selectedId = null;
        this.changed();
      } catch (error) {
        this.complain(`${file.name}: ${error.message}`);
      }
    },
  },
};
