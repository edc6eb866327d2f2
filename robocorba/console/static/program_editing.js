// What the user does with the program on the program page: methods of the page's component. Each change of `model` is
// followed by `changed()`.
import { download } from "/static/download.js";
import { firstValues } from "/static/icon_values.js";
import { newNode, nodeOf, plainOf, readProgram } from "/static/program_model.js";

const CLIPBOARD = "robocorba-icon";

export const editing = {
  // ---- icons ----
  // Add an icon where the user wants the next one: in the chosen list, in the selected icon, or after it.
  append(icon) {
    this.insertNode(this.newIcon(icon));
  },
  // An icon that works at once, as far as its kind says how.
  newIcon(icon) {
    const node = newNode(this.schema, icon);
    node.values = firstValues(icon, this.rows[this.robot]?.state?.at);
    return node;
  },
  insertNode(node) {
    const selected = this.node;
    const body = selected && Object.keys(selected.bodies)[0];
    if (this.place) this.model.insert(node, this.place.parentId, this.place.name, this.placeList().length);
    else if (body && !selected.bodies[body].length) this.model.insert(node, selected.id, body, 0);
    else this.model.insertAfter(this.selectedId, node);
    this.select(node.id);
    this.changed();
    this.reveal(node.id);
  },
  change(name, value) {
    this.model.set(this.selectedId, name, value);
    this.changed();
  },
  remove(id) {
    const { list, index, parent } = this.model.find(id);
    const next = list[index + 1] ?? list[index - 1] ?? parent;
    this.model.remove(id);
    this.select(next?.id ?? null);
    this.changed();
    if (next) this.focusCard(next.id);
  },
  moveBy(id, how, by) {
    const isMoved = how === "shift" ? this.model.shift(id, by) : this.model[how](id);
    if (!isMoved) return;
    this.changed();
    this.focusCard(id);
  },
  copyNode(node) {
    this.store(CLIPBOARD, JSON.stringify(plainOf(node)));
    this.note(`copied; paste with Ctrl+V`);
  },
  cutNode(node) {
    this.store(CLIPBOARD, JSON.stringify(plainOf(node)));
    this.remove(node.id);
  },
  pasteNode() {
    const text = this.stored(CLIPBOARD);
    if (!text) return this.note("nothing was copied yet");
    try {
      this.insertNode(nodeOf(this.schema, JSON.parse(text)));
    } catch (error) {
      this.note(`can't paste: ${error.message}`, "error");
    }
  },
  duplicate(node) {
    const copy = nodeOf(this.schema, plainOf(node));
    this.model.insertAfter(node.id, copy);
    this.select(copy.id);
    this.changed();
    this.reveal(copy.id);
  },
  select(id) {
    this.selectedId = id;
    this.place = null;
    if (id !== null) this.tab = "icon";
  },
  setPlace(parentId, name) {
    this.selectedId = null;
    this.place = { parentId, name };
  },
  placeList() {
    return this.model.body(this.place.parentId, this.place.name);
  },
  // ---- program ----
  rename(name) {
    this.model.remember();
    this.model.name = name.trim() || "program";
    this.changed();
  },
  undo() {
    this.model.undo();
    this.afterStep();
  },
  redo() {
    this.model.redo();
    this.afterStep();
  },
  afterStep() {
    if (!this.model.find(this.selectedId)) this.selectedId = null;
    this.place = null;
    this.changed();
  },
  clear() {
    this.replace({ name: "program", icons: [] });
  },
  replace(program) {
    this.model.load(program);
    this.run.close();
    this.dismiss();
    this.select(null);
    this.changed();
  },
  // ---- drag and drop ----
  dragNew(icon) {
    this.dragged = { icon };
  },
  dragNode(event, node) {
    this.dragged = { id: node.id };
    event.dataTransfer.setData("text/plain", node.icon);
    event.dataTransfer.effectAllowed = "move";
  },
  over(parentId, name, index) {
    if (this.dragged) this.target = { parentId, name, index };
  },
  drop(event) {
    const { dragged, target } = this;
    this.dragged = this.target = null;
    if (!event || !dragged || !target) return;
    if (dragged.icon) {
      const node = this.newIcon(dragged.icon);
      this.model.insert(node, target.parentId, target.name, target.index);
      this.select(node.id);
    } else if (!this.model.move(dragged.id, target.parentId, target.name, target.index)) {
      return;
    }
    this.changed();
  },
  // ---- keyboard ----
  key(event, node) {
    const isCommand = event.ctrlKey || event.metaKey, { key } = event;
    if (key === "Delete" || key === "Backspace") this.remove(node.id);
    else if (event.altKey && key === "ArrowUp") this.moveBy(node.id, "shift", -1);
    else if (event.altKey && key === "ArrowDown") this.moveBy(node.id, "shift", 1);
    else if (event.altKey && key === "ArrowRight") this.moveBy(node.id, "enter");
    else if (event.altKey && key === "ArrowLeft") this.moveBy(node.id, "leave");
    else if (key === "ArrowUp" || key === "ArrowDown") this.focusNext(node, key === "ArrowUp" ? -1 : 1);
    else if (key === "Enter") this.$refs.side.querySelector("input, select")?.focus();
    else if (isCommand && key === "d") this.duplicate(node);
    else if (isCommand && key === "x") this.cutNode(node);
    else if (isCommand && key === "c" && !String(getSelection())) this.copyNode(node);
    else return;
    event.preventDefault();
    event.stopPropagation();
  },
  pageKey(event) {
    if (!this.schema || !(event.ctrlKey || event.metaKey) || event.altKey) return;
    const key = event.key.toLowerCase();
    if (key === "s") this.save();
    else if (event.target.closest("input, textarea, select")) return;
    else if (key === "z" && !event.shiftKey) this.undo();
    else if (key === "y" || key === "z") this.redo();
    else if (key === "v") this.pasteNode();
    else return;
    event.preventDefault();
  },
  cards() {
    return [...this.$el.querySelectorAll(".icon-card")];
  },
  focusNext(node, by) {
    const cards = this.cards();
    cards[cards.findIndex((card) => Number(card.dataset.id) === node.id) + by]?.focus();
  },
  async focusCard(id) {
    await this.$nextTick();
    this.cards().find((card) => Number(card.dataset.id) === id)?.focus();
  },
  async reveal(id) {
    await this.$nextTick();
    this.cards().find((card) => Number(card.dataset.id) === id)?.scrollIntoView({ block: "nearest" });
  },
  // ---- files ----
  save() {
    download(`${this.model.name.slice(0, 80) || "program"}.json`, `${this.jsonText}\n`, "application/json");
  },
  async open(file) {
    try {
      this.openText(file.name, await file.text());
    } catch (error) {
      this.note(`${file.name} can't be read: ${error.message}`, "error");
    }
  },
  openText(name, text) {
    try {
      this.replace(readProgram(this.schema, text));
      this.note(`opened ${name}`);
      return true;
    } catch (error) {
      this.note(`${name}: ${error.message}`, "error");
      return false;
    }
  },
  // ---- what the browser keeps ----
  store(key, text) {
    try {
      localStorage.setItem(key, text);
    } catch {
      this.note("the browser keeps no data: save the program as a file", "error");
    }
  },
  stored(key) {
    try {
      return localStorage.getItem(key);
    } catch {
      return null;
    }
  },
};
