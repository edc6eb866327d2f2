// Methods of the map page: edits of elements and floors, and what becomes of them.
import { copyOf, idOf } from "/static/map_model.js";
import { alignEdits, changeOf, current, duplicateEdits, removeEdits } from "/static/map_selection.js";
import { editsOf } from "/static/map_tools.js";

export const editingMethods = {
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
};
