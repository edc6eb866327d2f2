// The map page: a floor with drawing tools, and panels for the selected element, findings, paths and files.
import { FloorCanvas } from "/static/floor_canvas.js";
import { call, live } from "/static/live.js";
import { editingMethods } from "/static/map_editing.js";
import { fileMethods, FilesPanel } from "/static/map_files.js";
import { followingMethods } from "/static/map_following.js";
import { MapForm, shown } from "/static/map_form.js";
import { MapHands } from "/static/map_hands.js";
import { MapLayer } from "/static/map_layer.js";
import { EditsPanel, FindingsPanel, PathsPanel } from "/static/map_panels.js";
import { planningMethods } from "/static/map_planning.js";
import { ProposalLayer, proposalMethods, ProposalsPanel } from "/static/map_proposals.js";
import { ALIGNMENTS } from "/static/map_selection.js";
import { MapSession } from "/static/map_session.js";
import { rememberView } from "/static/shared_view.js";
import { toolOf, TOOLS } from "/static/map_tools.js";
import TabList from "/static/tab_list.js";
import ViewTools from "/static/view_tools.js";

const GRID_STEPS = [0.05, 0.1, 0.25, 0.5, 1];
const PANELS = [
  { name: "element", title: "Element" }, { name: "findings", title: "Findings" }, { name: "paths", title: "Path" },
  { name: "seen", title: "Seen" }, { name: "files", title: "Files" }, { name: "edits", title: "Edits" },
];

export default {
  components: { EditsPanel, FilesPanel, FindingsPanel, MapForm, PathsPanel, ProposalsPanel, TabList, ViewTools },
  directives: { shown },
  template: `
    <div class="console-split map-page">
      <section class="map-main">
        <div class="map-bar">
          <TabList class="map-floors" label="Floors" :names="floors" :chosen="current" @choose="show">
            <button title="Add a floor" aria-label="Add a floor" @click="addFloor">+</button></TabList>
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
            <ViewTools :canvas="() => canvas" />
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
    this.onKey = (event) => this.hands.key(event);
    window.addEventListener("keydown", this.onKey);
    this.loadForms();
    this.followProposals();
    this.receive("connection");
  },
  unmounted() {
    this.unlisten();
    live.want(this.layer);
    window.removeEventListener("keydown", this.onKey);
    this.isClosed = true;
    this.hands.leave();
    clearTimeout(this.messageTimer);
    clearTimeout(this.formsTimer);
    clearTimeout(this.proposalTimer);
    this.session.end();
    this.canvas.close();
  },
  methods: {
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

    ...followingMethods,
    ...editingMethods,
    ...planningMethods,
    ...proposalMethods,
    ...fileMethods,
  },
};
