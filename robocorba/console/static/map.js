// The map page: a floor with drawing tools, and panels for the selected element, findings, paths and files.
import { FloorCanvas } from "/static/floor_canvas.js";
import { call, live } from "/static/live.js";
import { fileMethods, FilesPanel } from "/static/map_files.js";
import { MapForm, shown } from "/static/map_form.js";
import { MapHands } from "/static/map_hands.js";
import { MapLayer } from "/static/map_layer.js";
import { copyOf, handlesOf, idOf } from "/static/map_model.js";
import { EditsPanel, FindingsPanel, PathsPanel } from "/static/map_panels.js";
import { planningMethods } from "/static/map_planning.js";
import { ProposalLayer, proposalMethods, ProposalsPanel } from "/static/map_proposals.js";
import { ALIGNMENTS, alignEdits, changeOf, current, duplicateEdits, removeEdits } from "/static/map_selection.js";
import { MapSession } from "/static/map_session.js";
import { rememberView, sharedView } from "/static/shared_view.js";
import { editsOf, toolOf, TOOLS } from "/static/map_tools.js";

const GRID_STEPS = [0.05, 0.1, 0.25, 0.5, 1];
const PANELS = [
  { name: "element", title: "Element" }, { name: "findings", title: "Findings" }, { name: "paths", title: "Path" },
  { name: "seen", title: "Seen" }, { name: "files", title: "Files" }, { name: "edits", title: "Edits" },
];
// A message of another editor's edit stays for this time [ms].
const MESSAGE_MS = 8000;

export default {
  components: { EditsPanel, FilesPanel, FindingsPanel, MapForm, PathsPanel, ProposalsPanel },
  directives: { shown },
  template: `
    <div class="console-split map-page">
      <section class="map-main">
        <div class="map-bar">
          <div class="console-tabs map-floors" role="tablist" aria-label="Floors">
            <button v-for="floor in floors" :key="floor" role="tab" :aria-selected="floor === current" :title="floor"
                @click="show(floor)">{{ floor }}</button>
            <button title="Add a floor" aria-label="Add a floor" @click="addFloor">+</button></div>
          <q-btn flat dense icon="undo" :disable="!undoable"
              :title="undoable ? 'Undo: ' + undoable : 'Nothing of yours to undo'" aria-label="Undo" @click="undo" />
          <q-btn flat dense icon="redo" :disable="!redoable"
              :title="redoable ? 'Redo: ' + redoable : 'Nothing of yours to redo'" aria-label="Redo" @click="redo" />
          <span class="map-saved" title="Every edit is saved at once. Undo takes yours back."
              ><q-icon :name="saving ? 'sync' : 'cloud_done'" size="16px" /> {{ saving ? "saving" : "saved" }}</span>
          <label class="map-author" title="Others see this name beside your edits">as <input v-shown="author"
              maxlength="60" aria-label="Your name" @change="setAuthor($event.target)"></label>
        </div>
        <div class="map-work">
          <div class="map-tools" role="toolbar" aria-label="Tools" aria-orientation="vertical">
            <button v-for="each in tools" :key="each.name" :aria-pressed="each.name === tool"
                :title="each.title + ' (' + each.key.toUpperCase() + '): ' + each.help" @click="setTool(each.name)">
              <q-icon :name="each.icon" size="20px" /><span>{{ each.title }}</span></button>
          </div>
          <div class="console-scene">
            <canvas ref="canvas" tabindex="0" :aria-label="'Map of floor ' + current"
                :style="{ cursor: tool === 'select' ? 'default' : tool === 'pan' ? 'grab' : 'crosshair' }"></canvas>
            <div v-if="overlay" class="console-overlay">{{ overlay }}</div>
            <div class="map-options">
              <label>grid <select v-model.number="step" aria-label="Grid step"><option v-for="each in gridSteps"
                  :key="each" :value="each">{{ each }} m</option></select></label>
              <label v-if="kind === 'object'"><input v-model="options.isMovable" type="checkbox"> movable</label>
              <label v-if="kind === 'edge'"><input v-model="options.isOneWay" type="checkbox"> one way</label>
              <label v-if="kind === 'door'">kind <select v-model="options.doorKind"><option v-for="each in doorKinds"
                  :key="each">{{ each }}</option></select></label>
              <label v-if="kind === 'elevator'">doors <select v-model="options.side"><option v-for="each in sides"
                  :key="each">{{ each }}</option></select></label>
              <span class="map-help">{{ help }}</span>
            </div>
            <div class="console-tools">
              <q-btn dense flat icon="fit_screen" aria-label="Show the whole floor"
                  @click="canvas.fit()" />
              <q-btn dense flat icon="add" aria-label="Enlarge" @click="canvas.zoom(1.4)" />
              <q-btn dense flat icon="remove" aria-label="Reduce" @click="canvas.zoom(1 / 1.4)" />
            </div>
            <div class="map-message" :class="{ 'is-problem': message.isProblem }" role="status">{{ message.text }}</div>
          </div>
        </div>
      </section>
      <aside class="console-side" aria-label="Panel">
        <div class="console-tabs" role="tablist" aria-label="Panels">
          <button v-for="each in panels" :key="each.name" role="tab" :aria-selected="each.name === panel"
              @click="panel = each.name">
            {{ each.title }}<small
                v-if="each.name === 'findings' && found?.count"> {{ found.count }}</small><small
                v-if="each.name === 'seen' && proposals.length"> {{ proposals.length }}</small></button></div>
        <div class="map-panel">
          <template v-if="panel === 'element' && forms">
            <template v-if="records.length <= 1 && shownRecord">
              <h2 class="console-heading">{{ shownRecord.kind }} {{ shownRecord.name }}</h2>
              <map-form :key="formKey" :forms="forms" :record="shownRecord" :names="names" :note="note"
                  @change="changeMember" @rename="rename" @overtaken="showOvertaken($event.detail)"></map-form>
            </template>
            <template v-else-if="records.length > 1">
              <h2 class="console-heading">{{ records.length }} selected: {{ countText }}</h2>
              <div class="console-actions" role="group" aria-label="Align">
                <q-btn v-for="each in alignments" :key="each.name" dense outline :icon="each.icon"
                    :title="'Align ' + each.name" :aria-label="'Align ' + each.name" @click="align(each.name)" /></div>
            </template>
            <p v-else class="map-none">{{ overlay || 'There is no floor yet: add one with +.' }}</p>
            <div v-if="records.length" class="console-actions">
              <q-btn dense no-caps outline icon="content_copy" label="Duplicate" title="Ctrl+D"
                  @click="duplicateSelected" />
              <q-btn dense no-caps outline icon="delete" label="Delete" title="Delete key"
                  @click="removeSelected" /></div>
            <div v-else-if="shownRecord" class="console-actions">
              <q-btn dense no-caps outline icon="share" label="Generate roads"
                  title="Replaces all nodes and roads of this floor by generated ones" @click="buildRoads" />
              <q-btn dense no-caps outline icon="delete" label="Remove this floor" @click="removeFloor" /></div>
          </template>
          <findings-panel v-if="panel === 'findings'" :result="found" :refused="refused" :chosen="chosenFinding"
              :is-busy="isChecking" :radius="radius" :version="version" @check="check" @show="showFinding"
              @radius="radius = $event" @dismiss="refused = null"></findings-panel>
          <paths-panel v-if="panel === 'paths'" :paths="paths" :ends="ends" :chosen="chosenPath" :is-busy="isPlanning"
              :is-on="tool === 'path'"
              @choose="choosePath" @start="startPath" @clear="clearPath"></paths-panel>
          <proposals-panel v-if="panel === 'seen'" :proposals="proposals" :chosen="chosenProposal" @show="showProposal"
              @accept="acceptProposal" @reject="rejectProposal"></proposals-panel>
          <files-panel v-show="panel === 'files'" :floor="current" :version="version" :underlay="underlay"
              @replace="replace" @underlay="setUnderlay"></files-panel>
          <edits-panel v-if="panel === 'edits'" :news="news"></edits-panel>
        </div>
      </aside>
    </div>`,
  data() {
    return {
      tools: TOOLS, panels: PANELS, gridSteps: GRID_STEPS, alignments: ALIGNMENTS,
      sides: ["front", "back", "left", "right"],
      doorKinds: ["opening", "hinged", "double_hinged", "sliding", "double_sliding"],
      floors: [], current: "", tool: "select", panel: "element", step: 0.25, forms: null, author: "", version: 0,
      options: { isMovable: false, isOneWay: false, doorKind: "sliding", side: "front" },
      selected: [], records: [], shownRecord: null, note: "", formKey: 0, names: {}, undoable: "", redoable: "",
      news: [],
      // Points of the half-drawn element, and edits that are not answered yet.
      drawn: 0, saving: 0,
      found: null, refused: null, chosenFinding: -1, isChecking: false, radius: 0.4, overlay: "connecting",
      proposals: [], chosenProposal: "", paths: [], ends: [], chosenPath: "smoothed", isPlanning: false, underlay: null, message: { text: "" },
    };
  },
  computed: {
    toolDefinition() {
      return toolOf(this.tool);
    },
    kind() {
      return this.toolDefinition.kind;
    },
    help() {
      const { help, next } = this.toolDefinition;
      const isBegun = this.tool === "path" ? this.ends.length === 1 : this.drawn > 0;
      return isBegun && next ? next : help;
    },
    countText() {
      const counts = new Map();
      for (const { kind } of this.records) counts.set(kind, (counts.get(kind) ?? 0) + 1);
      return [...counts].map(([kind, count]) => `${count} ${kind}${count > 1 ? "s" : ""}`).join(", ");
    },
  },
  created() {
    this.layer = new MapLayer();
    this.proposalLayer = new ProposalLayer();
    this.session = new MapSession(() => this.update(), (text, isProblem) => this.say(text, isProblem));
    this.hands = new MapHands(this);
    this.elements = this.layer.elements = this.session.elements;
    // The element that was renamed last, {from, to} as ids; and what the form shows, which stays in it then.
    this.renamed = { from: "", to: "" };
    this.formId = "";
    this.author = this.session.author;
  },
  mounted() {
    this.canvas = new FloorCanvas(this.$refs.canvas, { pointer: (...news) => this.hands.pointer(...news) });
    this.canvas.isShownRoadmap = true;
    this.canvas.overlays.push(this.layer, this.proposalLayer);
    this.unlisten = live.listen((kind, name) => this.receive(kind, name));
    this.listeners = {
      keydown: (event) => this.hands.key(event),
      "robocorba-colors": () => this.canvas.redraw(),
    };
    for (const [name, listener] of Object.entries(this.listeners)) window.addEventListener(name, listener);
    this.loadForms();
    this.followProposals();
    this.receive("connection");
  },
  unmounted() {
    this.unlisten();
    live.want(this.layer);
    for (const [name, listener] of Object.entries(this.listeners)) window.removeEventListener(name, listener);
    this.isClosed = true;
    this.hands.leave();
    clearTimeout(this.messageTimer);
    clearTimeout(this.formsTimer);
    clearTimeout(this.proposalTimer);
    this.session.end();
    this.canvas.close();
  },
  methods: {
    // ---- news ----

    receive(kind, name) {
      if (kind === "connection") {
        const isBehind = live.mapVersion !== this.session.version || this.session.problem;
        if (live.isConnected && isBehind) this.session.refresh();
        this.updateOverlay();
      }
      if (kind === "connection" || (kind === "plan" && name === this.current)) this.showPlan();
      if (kind === "floor" && name === this.current && this.layer.takePlaces(live.floor(name))) this.canvas.redraw();
    },
    showPlan() {
      const isKnown = live.mapVersion >= this.session.version; // else the console does not follow a new floor yet
      const plan = this.current && isKnown ? live.plan(this.current) : this.canvas.plan;
      if (plan?.name !== this.current) {
        this.canvas.setPlan(null);
        this.updateOverlay();
        return this.canvas.redraw();
      }
      this.canvas.setPlan(plan);
      if (!this.hands.press && !this.hands.nudge) this.layer.ghosts = [];
      this.updateOverlay();
      return this.canvas.redraw();
    },
    updateOverlay() {
      if (!live.isConnected) this.overlay = "the console does not answer; reconnecting";
      else if (live.problems.map) this.overlay = live.problems.map;
      else if (this.session.problem) this.overlay = this.session.problem;
      else this.overlay = this.current && !(this.canvas.plan && this.isLoaded()) ? "loading the map" : "";
    },
    // Whether the elements are those of the floor that is shown.
    isLoaded() {
      return this.elements.floor === this.current;
    },
    // Whether one can edit the floor; tells why not.
    isReady() {
      if (!this.current) this.say("there is no floor yet: add one with +");
      return this.current !== "" && this.isLoaded();
    },
    // The session has new elements, or something to undo.
    update() {
      const { session } = this;
      this.elements = this.layer.elements = session.elements;
      if (this.current) this.layer.takePlaces(live.floor(this.current));
      if (this.found && this.found.version !== session.version) this.layer.findings = []; // of the map before
      Object.assign(this, { version: session.version, undoable: session.undoable, redoable: session.redoable,
        news: [...session.news] });
      if (session.whole && session.whole === session.version) this.undoable = "generated roads or an imported building";
      const floors = this.elements.of("floor").sort((a, b) => a.members.level - b.members.level);
      this.floors = floors.map((each) => each.name);
      if (this.floors.length && !this.floors.includes(this.current)) {
        const { from, to } = this.renamed;
        const newName = from === `floor/${this.current}` ? to.slice("floor/".length) : "";
        this.show([newName, sharedView.floor].find((each) => this.floors.includes(each)) ?? this.floors[0]);
      }
      const namesOf = (kind) => this.elements.of(kind).map((each) => each.name);
      const names = { floor: namesOf("floor"), node: namesOf("node"), elevator: namesOf("elevator") };
      if (JSON.stringify(names) !== JSON.stringify(this.names)) this.names = names;
      this.updateOverlay();
      this.updateSelection();
    },
    updateSelection() {
      const { from, to } = this.renamed;
      const now = (id) => (id === from && !this.elements.get(id) ? to : id);
      const records = this.isLoaded() ? current(this.selected.map(now), this.elements) : [];
      this.selected = records.map(idOf);
      this.layer.selected = records;
      this.layer.handles = records.length === 1 && this.tool === "select" ? handlesOf(records[0]) : [];
      this.records = records;
      const floor = this.elements.get(`floor/${this.current}`);
      this.shownRecord = records[0] ?? floor ?? null;
      const id = this.shownRecord ? idOf(this.shownRecord) : "";
      if (id !== this.formId && !(this.formId === from && id === to)) this.formKey += 1;
      this.formId = id;
      this.canvas?.redraw();
    },
    say(text, isProblem = false) {
      this.message = { text, isProblem };
      clearTimeout(this.messageTimer);
      this.messageTimer = setTimeout(() => (this.message = { text: "" }), isProblem ? 2 * MESSAGE_MS : MESSAGE_MS);
    },

    // ---- view ----

    show(floor) {
      this.hands.leave();
      this.current = floor;
      rememberView({ floor });
      live.want(this.layer, { floors: [floor] });
      this.layer.places.clear();
      this.canvas.floor = null;
      this.layer.ghosts = [];
      this.select([]);
      this.session.refresh(floor);
      this.showPlan();
      this.loadUnderlay();
    },
    setTool(name) {
      this.tool = name;
      this.layer.tool = toolOf(name);
      this.hands.draft = [];
      if (name === "path") this.panel = "paths";
      this.updateSelection();
      this.$refs.canvas.focus({ preventScroll: true });
    },
    select(ids) {
      this.hands.flush();
      this.selected = ids;
      this.note = "";
      if (ids.length && this.panel !== "findings") this.panel = "element";
      this.updateSelection();
    },
    async setAuthor(target) {
      await this.session.rename(target.value);
      this.author = target.value = this.session.author;
    },
    async loadForms() {
      try {
        this.forms = await call("map_forms");
      } catch {
        if (this.isClosed) return;
        this.formsTimer = setTimeout(() => this.loadForms(), 2000);
      }
    },

    // ---- editing ----

    // Make edits. Returns the answer, or undefined if the server did not answer.
    async commit(edits) {
      if (!edits.length) return undefined;
      this.canvas.isFitted = false; // the view stays as it is while one edits
      this.layer.ghosts = edits.filter((edit) => edit.members);
      this.canvas.redraw();
      const answer = await this.saved(this.session.edit(edits));
      if (!answer?.version) this.layer.ghosts = [];
      this.takeAnswer(answer);
      return answer;
    },
    // The answer to an edit, which is shown as under way until then.
    async saved(answer) {
      this.saving += 1;
      try {
        return await answer;
      } finally {
        this.saving -= 1;
      }
    },
    takeAnswer(answer) {
      this.note = "";
      if (answer?.version) {
        this.refused = null;
      } else if (answer?.refused) {
        this.showRefusal(answer.refused);
      }
      if (!answer?.version) this.resetForm();
      this.updateSelection();
    },
    // Show what the server has instead of what was typed and refused; the focus stays in its field.
    resetForm() {
      const fields = () => [...this.$el.querySelectorAll(".map-form :is(input, select, button)")];
      const at = fields().indexOf(document.activeElement);
      this.formKey += 1;
      if (at >= 0) this.$nextTick(() => fields()[at]?.focus());
    },
    showOvertaken({ typed, latest }) {
      this.note = `Somebody has set this to ${latest} while you typed ${typed}. Type it again to set it.`;
    },
    showRefusal(refused) {
      const { stale } = refused;
      if (stale && this.selected.includes(`${stale.kind}/${stale.name}`)) {
        this.note = "Somebody has changed this element meanwhile. You see it as it is now; your change was not made.";
        this.panel = "element";
        return;
      }
      this.refused = refused;
      this.layer.findings = refused.problems;
      this.say(refused.reason, true);
      if (refused.problems.length > 1) this.panel = "findings";
    },
    async createDrawn(tool, points) {
      const make = () => editsOf(tool, points, this.elements, this.options);
      const { floor } = this.elements;
      const isLeft = () => floor !== this.current;
      let edits = make();
      if (!edits.length) return;
      let answer = await this.commit(edits);
      if (answer?.refused?.taken && !isLeft()) {
        edits = make(); // somebody else has used a name meanwhile
        answer = await this.commit(edits);
      }
      if (!answer?.version || isLeft()) return;
      // Of a room its area, which is given a name in the form.
      const chosen = tool.name === "room" ? edits.filter((edit) => edit.kind === "area") : edits;
      if (tool.name !== "outline") this.select(chosen.map(idOf));
    },
    // The record as it is after moves by keys and edits that are under way.
    async latest(record) {
      await this.hands.flush();
      await this.session.changing;
      const now = this.elements.get(idOf(record));
      return now?.floor === record.floor ? now : record;
    },
    async changeMember(name, value) {
      const record = await this.latest(this.shownRecord);
      this.commit([changeOf(record, { ...copyOf(record.members), [name]: value })]);
    },
    async rename(name) {
      const record = await this.latest(this.shownRecord);
      this.renamed = { from: idOf(record), to: idOf({ ...record, name }) };
      const answer = await this.commit([{ ...record, do: "rename", to: name, members: undefined }]);
      if (!answer?.version) return;
      if (record.kind === "floor") this.show(name);
      else this.select([idOf({ ...record, name })]);
    },
    async removeSelected() {
      await this.hands.flush();
      const { edits, kept } = removeEdits(current(this.selected, this.elements));
      if (kept.length) {
        const names = kept.map((node) => node.name).join(", ");
        const { elevator } = kept[0].members;
        this.say(`kept ${names}: elevator ${elevator} stops there; remove it, or clear their elevator first`, true);
      }
      this.commit(edits);
    },
    async duplicateSelected() {
      await this.hands.flush();
      const records = current(this.selected, this.elements);
      if (!records.length) return;
      const edits = duplicateEdits(records, this.elements, this.step);
      const answer = await this.commit(edits);
      if (!answer?.version) return;
      this.select(edits.map(idOf));
      this.$refs.canvas.focus({ preventScroll: true }); // arrow keys move the copies
    },
    async align(how) {
      await this.hands.flush();
      this.commit(alignEdits(current(this.selected, this.elements), this.elements, how));
    },
    async undo() {
      await this.hands.flush();
      this.takeAnswer(await this.saved(this.session.undo()));
    },
    async redo() {
      await this.hands.flush();
      this.takeAnswer(await this.saved(this.session.redo()));
    },

    // ---- floors ----

    async addFloor() {
      const floors = this.elements.of("floor").map((record) => record.members);
      const top = floors.reduce((best, each) => (best && best.level >= each.level ? best : each), null);
      this.elements.forgetNames();
      const members = {
        name: this.elements.newName("floor"), level: (top?.level ?? 0) + 1,
        elevation: top ? top.elevation + top.height + 1 : 0,
        outline: this.elements.get(`floor/${this.current}`)?.members.outline ?? [],
      };
      const answer = await this.commit([{ do: "create", kind: "floor", floor: "", name: members.name, members }]);
      if (answer?.version && this.current !== members.name) this.show(members.name); // else drawing on it has begun
    },
    async removeFloor() {
      const floor = this.elements.get(`floor/${this.current}`);
      const answer = await this.commit([{ ...floor, do: "remove" }]);
      if (answer?.version) this.say(`floor ${floor.name} is removed; undo brings it back`);
    },
    async buildRoads() {
      const isMade = await this.saved(this.session.changeWhole("map_build_roads",
        { floor: this.current, radius: this.radius }));
      if (isMade) this.say("roads generated");
    },

    ...planningMethods,
    ...proposalMethods,
    ...fileMethods,
  },
};
