// The graphic programming agent: a program is built from icons, checked, run on the virtual robot, and uploaded to the
// actual one.
import { IconForm } from "/static/icon_form.js";
import { IconList } from "/static/icon_list.js";
import { IconPalette } from "/static/icon_palette.js";
import { plainWords } from "/static/icon_looks.js";
import { problemLines } from "/static/icon_problems.js";
import { call, live } from "/static/live.js";
import { PosePicker } from "/static/pose_picker.js";
import { PosturePreview } from "/static/posture_preview.js";
import { ProgramBar } from "/static/program_bar.js";
import { checking, checkingState } from "/static/program_checking.js";
import { editing } from "/static/program_editing.js";
import { keepHistory, restoreHistory } from "/static/program_history.js";
import { ProgramModel, readProgram, Schema } from "/static/program_model.js";
import { ProgramRun } from "/static/program_run.js";
import { ProgramText } from "/static/program_text.js";
import { robotSide } from "/static/program_robot.js";
import { RunBar } from "/static/run_bar.js";
import { SwitchPanel } from "/static/switch_panel.js";
import { TargetMap } from "/static/target_map.js";
import { UploadPanel } from "/static/upload_panel.js";

const STORED = "robocorba-program";
// Icons whose target is picked on the map; icons for arms, whose pose can be made in 3D.
const TARGETS = ["mbase_path", "mbase_to", "move_table"], ARMS = ["mhand_joints", "mhand_pose"];
// Icons after which the robot is shown in 3D.
const PREVIEWED = ["mhand_posture", "lumbar"];
// A message about a file or the clipboard is shown for this time [ms].
const NOTE_MS = 8000;
// Windows of this width have room for the text beside the parameters.
const WIDE = "(min-width: 1700px)";

export default {
  components: {
    IconForm, IconList, IconPalette, PosePicker, PosturePreview, ProgramBar, ProgramText, RunBar, SwitchPanel, TargetMap,
    UploadPanel,
  },
  template: `
    <div class="program-page">
      <program-bar :name="model.name" :can-undo="canUndo" :can-redo="canRedo" :verdict="verdict"
                   :examples="Object.keys(examples)" :robot-program="rows[robot]?.state?.program.name ? robot : ''"
                   @rename="rename" @undo="undo" @redo="redo" @clear="clear" @open="open" @save="save"
                   @take="takeProgram"
                   @example="(name) => openText('the example ' + name, examples[name])"></program-bar>
      <run-bar :robots="robots" :robot="robotRow" :can-run="!whyNot" :why="whyNot" :progress="progress"
               @choose="choose" @run="start(false)" @step="step" @pause="pause" @abort="order('abort_program')"
               @release="order('reset_stop')" @panel="(name) => panel = panel === name ? '' : name"
               @dismiss="dismiss"></run-bar>
      <switch-panel v-if="panel === 'switch'" :robot="robot" :current="robotRow.adaptor" :program="model.name"
                    :can-run="!whyNot" @switched="switched" @close="panel = ''"></switch-panel>
      <upload-panel v-if="panel === 'upload'" :robot="robot" :program="model.name" :json="jsonText"
                    :can-run="!whyNot" @close="panel = ''"></upload-panel>
      <div v-if="!schema" class="console-message">{{ loading }}
        <q-btn v-if="isLoadFailed" dense no-caps outline label="Try again" @click="load" /></div>
      <div v-else class="program-columns">
        <icon-palette :schema="schema" @add="append" @drag="dragNew" @dropped="drop()"></icon-palette>
        <div class="program-middle">
        <section class="program-list" aria-label="Program" @click="select(null)"
                 @dragover.prevent="over(null, 'icons', model.icons.length)" @drop.prevent="drop($event)">
          <div v-for="(line, number) in lines(null)" :key="number" class="icon-problem" :class="'is-' + line.kind">
            <q-icon :name="line.kind === 'error' ? 'warning' : 'info'" size="16px" /> <span>{{ line.text }}</span></div>
          <icon-list :list="model.icons" :parent-id="null" list-name="icons" :editor="editor"></icon-list>
        </section>
        <p v-if="message.text" class="program-message" :class="'is-' + message.kind" role="status">
          {{ message.text }}</p>
        </div>
        <aside ref="side" class="program-side" aria-label="Parameters">
          <div v-if="!isWide" class="console-tabs" role="tablist" aria-label="Side">
            <button type="button" role="tab" :aria-selected="tab === 'icon'" @click="tab = 'icon'">Icon</button>
            <button type="button" role="tab" :aria-selected="tab === 'text'" @click="tab = 'text'">Text</button></div>
          <template v-if="node && isIconShown">
            <div class="program-parameters" @keydown.esc="focusCard(node.id)">
            <icon-form :schema="schema" :node="node" :choices="choices" :problems="problemsOf(node.id)" @change="change"
                       @shift="(by) => moveBy(node.id, 'shift', by)" @copy="copyNode(node)" @paste="pasteNode"
                       @remove="remove(node.id)"></icon-form>
            <div class="console-actions">
              <q-btn v-if="hasTarget" dense no-caps outline icon="my_location" :disable="!robot"
                     :label="'Where ' + short(robot) + ' is'" @click="takePose" />
              <q-btn v-if="isPosture" dense no-caps outline icon="accessibility_new" :disable="!robot"
                     :label="'As ' + short(robot) + ' stands'" @click="takePosture" />
              <q-btn v-if="isArm" dense no-caps outline icon="view_in_ar" label="Pose in 3D" :aria-pressed="isPosing"
                     @click="isPosing = !isPosing" />
              <q-btn v-if="topIndex >= 0" dense no-caps outline icon="start" label="Run from here"
                     :disable="Boolean(whyNot)" :title="whyNot" @click="start(false, topIndex)" />
            </div></div>
            <pose-picker v-if="isArm && isPosing" :key="node.id" :node="node" :robot="robot"
                         @take="(values) => setAll(node.id, values, 'pose')"></pose-picker>
            <posture-preview v-else-if="isPreviewed" :node="node" :robot="robot"></posture-preview>
            <target-map v-if="hasTarget" :target="targetValues" :others="otherTargets" @pick="pick"
                        :robot="robot" :robot-floor="rows[robot]?.state?.at.floor ?? ''"
                        :is-one-floor="node.icon === 'mbase_to'"></target-map>
          </template>
          <div v-else-if="isIconShown" class="console-message">{{ hint }}</div>
          <program-text v-if="!isWide && tab === 'text'" :json="jsonText" :python="python" :message="pythonMessage">
          </program-text>
        </aside>
        <aside v-if="isWide" class="program-beside">
          <program-text :json="jsonText" :python="python" :message="pythonMessage"></program-text></aside>
      </div>
    </div>`,
  data() {
    return {
      model: new ProgramModel(), schema: null, loading: "", isLoadFailed: false, examples: {}, postures: [],
      revision: 0,
      selectedId: null, place: null, target: null, tab: "icon", isPosing: false, isWide: matchMedia(WIDE).matches,
      incomplete: new Map(), ...checkingState(), ...robotSide.state(), message: { text: "", kind: "" },
    };
  },
  computed: {
    editor() {
      const { selectedId, place, target, marks: run } = this;
      const { select, setPlace, key, over, drop, dragNode: drag, lines } = this;
      return { selectedId, place, target, run, select, setPlace, key, over, drop, drag, lines };
    },
    node() {
      return this.selectedId === null ? null : this.model.find(this.selectedId)?.node ?? null;
    },
    topIndex() {
      return this.model.icons.findIndex((node) => node.id === this.selectedId);
    },
    jsonText() {
      return JSON.stringify(this.model.plain(), null, 2);
    },
    pythonMessage() {
      if (!this.model.icons.length) return "The program has no icons yet.";
      if (this.incomplete.size) return "Python comes when no icon is yellow.";
      return this.checkProblem || "The program is being checked, or can't be read.";
    },
    verdict() {
      const errors = this.findings.filter((finding) => finding.kind === "error").length;
      const notes = this.findings.length - errors, parts = [];
      if (!this.model.icons.length) return { text: "" };
      const isInvalid = (problems) => problems.some(({ kind }) => kind === "invalid");
      const invalid = [...this.incomplete.values()].filter(isInvalid).length;
      const incomplete = this.incomplete.size - invalid;
      if (incomplete) parts.push(`${incomplete} incomplete`);
      if (invalid) parts.push(`${invalid} not valid`);
      if (errors) parts.push(`${errors} not possible`);
      if (this.checkProblem) parts.push(this.checkProblem);
      if (parts.length) return { text: parts.join(", "), isProblem: true };
      if (!this.isChecked) return { text: "checking" };
      return { text: notes ? `checked, ${notes} ${notes > 1 ? "notes" : "note"}` : "checked", isOk: true };
    },
    // Why the program can't run; empty if it can.
    whyNot() {
      if (!this.robot) return "there is no robot";
      if (!this.model.icons.length) return "the program has no icons";
      if (this.incomplete.size) return "complete or repair the yellow icons";
      if (this.findings.some((finding) => finding.kind === "error")) return "repair the icons that are not possible";
      if (this.robotRow.condition !== "idle") return `${this.robot}: ${this.robotRow.shown || "not there"}`;
      return this.robotRow.problem;
    },
    // Known names for parameters that name something.
    choices() {
      const { objects = [], robots = [] } = this.names;
      const [things, others] = [{ names: objects }, { names: robots }];
      const floors = { names: this.floors, isClosed: true }, postures = { names: this.postures, isClosed: true };
      return { floor: floors, posture: postures, table: things, object: things, taker: others, giver: others };
    },
    isIconShown() {
      return this.isWide || this.tab === "icon";
    },
    hint() {
      if (this.model.icons.length) return "Select an icon to see its parameters.";
      return "Click an icon of the palette: it becomes the first of the program.";
    },
    hasTarget() {
      return TARGETS.includes(this.node?.icon);
    },
    targetValues() {
      return { ...this.targetOf(this.node) };
    },
    otherTargets() {
      return [...this.model.walk()]
        .filter(({ node }) => node.id !== this.selectedId && TARGETS.includes(node.icon))
        .map(({ node }) => this.targetOf(node))
        .filter(({ x, y }) => typeof x === "number" && typeof y === "number");
    },
    isPosture() {
      return this.isArm || this.node?.icon === "lumbar";
    },
    isPreviewed() {
      return PREVIEWED.includes(this.node?.icon);
    },
    isArm() {
      return ARMS.includes(this.node?.icon);
    },
    canUndo() {
      return this.revision >= 0 && this.model.done.length > 0;
    },
    canRedo() {
      return this.revision >= 0 && this.model.undone.length > 0;
    },
  },
  async mounted() {
    this.run = new ProgramRun((ask) => call("program_progress", ask), () => this.progressed());
    this.width = matchMedia(WIDE);
    this.width.onchange = () => (this.isWide = this.width.matches);
    this.unlisten = live.listen((kind) => kind !== "floor" && this.news(kind));
    this.onKey = (event) => this.pageKey(event);
    window.addEventListener("keydown", this.onKey);
    this.onLeave = () => this.schema && keepHistory(this.model, this.schema, this.selectedId);
    window.addEventListener("pagehide", this.onLeave);
    await this.load();
  },
  unmounted() {
    this.unlisten();
    live.want(this);
    this.run.close();
    clearTimeout(this.checkTimer);
    clearTimeout(this.noteTimer);
    this.width.onchange = null;
    window.removeEventListener("keydown", this.onKey);
    window.removeEventListener("pagehide", this.onLeave);
    this.onLeave();
  },
  methods: {
    ...editing,
    ...checking,
    ...robotSide.methods,
    async load() {
      this.loading = "loading the icons";
      this.isLoadFailed = false;
      try {
        const { schema, postures } = await call("program_schema");
        this.schema = new Schema(schema);
        this.postures = postures;
        this.examples = await call("example_programs");
      } catch (error) {
        this.loading = error.message;
        this.isLoadFailed = true;
        return;
      }
      this.restore();
      this.news();
      this.changed();
      this.robotChosen();
    },
    // The program as this tab left it, or as the browser left it last.
    restore() {
      const stored = this.stored(STORED), selectedId = restoreHistory(this.model, this.schema);
      if (selectedId !== undefined) return this.select(selectedId);
      try {
        if (stored) Object.assign(this.model, readProgram(this.schema, stored));
      } catch {
        // of an older version
      }
    },
    changed() {
      this.revision++;
      this.findIncomplete();
      this.findings = this.findings.filter((finding) => this.model.find(finding.nodeId));
      this.store(STORED, this.jsonText);
      this.checkSoon();
    },
    // What is shown of an icon's problems; of the whole program for null.
    lines(id) {
      return problemLines(this.problemsOf(id));
    },
    note(text, kind = "") {
      this.message = { text: plainWords(text), kind };
      clearTimeout(this.noteTimer);
      if (kind !== "error") this.noteTimer = setTimeout(() => (this.message = { text: "", kind: "" }), NOTE_MS);
    },
    short(name) {
      return [...name].length > 12 ? "the robot" : name || "the robot";
    },
  },
};
