// Methods of the map page: what it shows follows the server, the session, and what is selected.
import { live } from "/static/live.js";
import { handlesOf, idOf } from "/static/map_model.js";
import { current } from "/static/map_selection.js";
import { sharedView } from "/static/shared_view.js";

// A message of another editor's edit stays for this time [ms].
const MESSAGE_MS = 8000;

export const followingMethods = {
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
};
