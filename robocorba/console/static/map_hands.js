// Pointer and keys on the map: drawing with a tool, selecting, moving and dragging handles.
import { distance, idOf, rounded } from "/static/map_model.js";
import { changeOf, current, joinedEdits, moveEdits, toggled } from "/static/map_selection.js";
import { onGrid, snap } from "/static/map_snap.js";
import { closes, TOOLS } from "/static/map_tools.js";

const CLICK_PX = 6;
const REACH_PX = 7;
const NUDGE_MS = 400;
// Fields take all keys; a button or a tab takes those that would press it or move between tabs.
const FIELDS = "form, input, select, textarea";
const BUTTONS = "button, a, [role=tab]";
const BUTTON_KEYS = ["Enter", " ", "Delete", "Backspace", "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"];
const handled = () => true; // whatever an action answers
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class MapHands {
  // page: the map page, with elements, layer, canvas, step, toolDefinition, selected (ids) and the methods called here.
  constructor(page) {
    this.page = page;
    this.press = null;
    // Presses of arrow keys that are not sent yet: {ids, delta, timer}; and the promise of those that are.
    this.nudge = null;
    this.sending = null;
  }

  // Forget what was begun on a floor that is left; a move by keys is sent.
  leave() {
    this.flush();
    this.press = null;
    this.draft = [];
  }

  get draft() {
    return this.page.layer.draft;
  }

  set draft(points) {
    this.page.layer.draft = points;
    this.page.drawn = points.length;
    this.page.canvas.redraw();
  }

  pointer(kind, event, point) {
    const tool = this.page.toolDefinition;
    if (tool.name === "pan" || kind === "menu") return false;
    if (kind === "leave") {
      if (!this.press) this.showCursor(null);
      return false;
    }
    if (kind === "down") {
      if (event.button !== 0 || !this.page.isReady()) return false;
      this.flush();
      this.press = { px: [event.clientX, event.clientY], point, isShift: event.shiftKey, hasMoved: false };
      return tool.points ? this.beginDrawing(event, point) : this.beginSelecting(event, point);
    }
    if (this.press && !this.press.hasMoved) {
      this.press.hasMoved = Math.hypot(event.clientX - this.press.px[0], event.clientY - this.press.px[1]) > CLICK_PX;
    }
    if (tool.points) this.draw(tool, kind, event, point);
    else this.select(kind, event, point);
    if (kind === "up" || kind === "cancel") this.press = null;
    return false;
  }

  snapped(event, point, more = {}) {
    const { canvas, elements, step } = this.page;
    return snap(point, elements, { scale: canvas.scale, step, isOff: event.altKey, ...more });
  }

  showCursor(cursor) {
    this.page.layer.cursor = cursor;
    this.page.canvas.redraw();
  }

  // ---- drawing ----

  beginDrawing(event, point) {
    this.press.start = this.drawn(event, point).at;
    return true;
  }

  drawn(event, point) {
    if (this.page.toolDefinition.name === "path") {
      const near = this.page.elements.of("node").find((node) => distance(node.members.at,
        point) < 10 / this.page.canvas.scale);
      return near ? { at: near.members.at, to: "node" } : { at: point.map(rounded), to: "" };
    }
    return this.snapped(event, point, { last: this.draft[this.draft.length - 1], own: this.draft });
  }

  draw(tool, kind, event, point) {
    const cursor = this.drawn(event, point);
    this.showCursor(cursor);
    const isDragged = this.press?.hasMoved && tool.points[1] === 2 && tool.name !== "path";
    if (kind === "move" && isDragged && !this.draft.length) this.draft = [this.press.start];
    if (kind === "up") this.add(cursor.at);
    if (kind === "double" && this.draft.length >= tool.points[0]) this.finish();
    if (kind === "cancel" && isDragged) this.draft = [];
  }

  add(point) {
    const tool = this.page.toolDefinition;
    if (tool.name === "path") return this.page.addPathEnd(point);
    if (closes(tool, this.draft, point)) return this.finish();
    const last = this.draft[this.draft.length - 1];
    if (last && distance(last, point) < 1e-6) return undefined;
    this.draft = [...this.draft, point];
    return this.draft.length >= tool.points[1] ? this.finish() : undefined;
  }

  finish() {
    const points = this.draft;
    const tool = this.page.toolDefinition;
    this.draft = [];
    if (tool.points && points.length >= tool.points[0]) this.page.createDrawn(tool, points);
  }

  // ---- selecting ----

  beginSelecting(event, point) {
    const { elements, canvas, layer, selected } = this.page;
    const reach = REACH_PX / canvas.scale;
    const handle = layer.handles.find((each) => distance(each.at, point) < reach * 1.4);
    if (handle && !event.shiftKey) {
      Object.assign(this.press, { handle, record: layer.selected[0] });
      return true;
    }
    const record = elements.at(point, reach);
    this.press.record = record;
    if (!record) {
      this.press.isFrame = true;
    } else if (record.kind === "area" && !selected.includes(idOf(record)) && elements.gapToBorder(record,
      point) > reach) {
      this.press.isFrame = true; // a drag within a room selects what is in it, a click the room
      this.press.under = record;
    } else if (event.shiftKey) {
      this.page.select(toggled(selected, record));
    } else if (!selected.includes(idOf(record))) {
      this.page.select([idOf(record)]);
    } else {
      this.press.wasSelected = true;
    }
    return true;
  }

  select(kind, event, point) {
    const { press } = this;
    const { layer, canvas } = this.page;
    if (!press) return;
    if (press.hasMoved && kind !== "cancel") this.drag(event, point);
    if (kind === "up") this.drop(point);
    if (kind === "cancel") layer.ghosts = [];
    if (kind !== "move") layer.frame = null;
    canvas.redraw();
  }

  drag(event, point) {
    const { press } = this;
    const { layer, elements, selected } = this.page;
    if (press.isFrame) {
      layer.frame = [press.point, point];
      return;
    }
    const skip = new Set(selected);
    if (press.record) press.record = elements.get(idOf(press.record)) ?? press.record; // it may have been moved by keys
    if (press.handle) {
      const { at } = press.handle.isTurn ? { at: point } : this.snapped(event, point, { skip });
      const joined = event.ctrlKey ? [] : joinedEdits(press.record, press.handle.at, at, elements);
      press.edits = [changeOf(press.record, press.handle.members(at)), ...joined];
    } else if (press.record && !press.isShift) {
      const records = current(selected, elements);
      const [from] = elements.outline(press.record).points;
      const to = this.snapped(event, [from[0] + point[0] - press.point[0], from[1] + point[1] - press.point[1]],
        { skip }).at;
      press.edits = moveEdits(records, [to[0] - from[0], to[1] - from[1]]);
    }
    layer.ghosts = press.edits ?? [];
  }

  drop(point) {
    const { press } = this;
    const { elements, selected } = this.page;
    if (press.edits) this.page.commit(press.edits);
    else if (press.isFrame && press.hasMoved) {
      const found = elements.within(press.point, point).map(idOf);
      this.page.select(press.isShift ? [...new Set([...selected, ...found])] : found);
    } else if (press.under) this.page.select(press.isShift ? toggled(selected, press.under) : [idOf(press.under)]);
    else if (press.isFrame && !press.isShift) this.page.select([]);
    else if (press.wasSelected && !press.hasMoved && !press.isShift) this.page.select([idOf(press.record)]);
  }

  // ---- keys ----

  key(event) {
    if (event.defaultPrevented) return;
    if (event.target.closest?.(FIELDS)) return this.keyInField(event);
    if (BUTTON_KEYS.includes(event.key) && event.target.closest?.(BUTTONS)) return;
    if (this.act(event)) event.preventDefault();
  }

  // Escape leaves a field of the page without a change.
  keyInField({ key, target }) {
    if (key !== "Escape" || !this.page.$el.contains(target)) return;
    if (target.shownText !== undefined) target.value = target.shownText;
    this.page.canvas.canvas.focus({ preventScroll: true });
  }

  act(event) {
    const { page } = this;
    const letter = event.key.toLowerCase();
    if (event.ctrlKey || event.metaKey) return this.command(letter, event.shiftKey);
    if (ARROWS[event.key]) return this.arrow(ARROWS[event.key], event.shiftKey);
    if (event.key === "Escape") return this.escape();
    if (event.key === "Enter" && this.draft.length) return handled(this.finish());
    if (event.key === "Backspace" && this.draft.length) return handled(this.dropPoint());
    // Backspace is also a key of typing, and a field that disappears leaves the focus on no element.
    const isRemoval = event.key === "Delete" || (event.key === "Backspace" && event.target === page.canvas.canvas);
    if (isRemoval) return handled(page.removeSelected());
    if (event.key === " " && page.toolDefinition.points) return handled(this.keyPoint());
    if (event.key === "+") return handled(page.canvas.zoom(1.4));
    if (event.key === "-") return handled(page.canvas.zoom(1 / 1.4));
    if (event.key === "0") return handled(page.canvas.fit());
    const tool = !event.altKey && TOOLS.find((each) => each.key === letter);
    return tool ? handled(page.setTool(tool.name)) : false;
  }

  dropPoint() {
    this.draft = this.draft.slice(0, -1);
  }

  command(letter, isShift) {
    const { page } = this;
    if (letter === "z" && !isShift && this.draft.length) return handled(this.dropPoint());
    if (letter === "z") return handled(isShift ? page.redo() : page.undo());
    if (letter === "y") return handled(page.redo());
    if (letter === "a") return handled(page.select(page.elements.shown.map(idOf)));
    if (letter === "d") return handled(page.duplicateSelected());
    return false;
  }

  // The first Escape ends a drag or a drawing, the next one puts the tool away, the next one deselects.
  escape() {
    const { page } = this;
    if (this.press?.edits) {
      this.press = null;
      page.layer.ghosts = [];
    } else if (this.draft.length) this.draft = [];
    else if (page.tool === "path" && page.ends.length === 1) page.clearPath();
    else if (page.tool !== "select") page.setTool("select");
    else page.select([]);
    page.canvas.redraw();
    return true;
  }

  // Arrows move what is selected, or the cursor of a tool, by a step of the grid (ten with Shift); else the view.
  arrow([dx, dy], isShift) {
    const { page } = this;
    const step = page.step * (isShift ? 10 : 1);
    if (page.toolDefinition.points) {
      const from = page.layer.cursor?.at ?? page.canvas.centre.map((value) => onGrid(value, page.step));
      this.showCursor({ at: [rounded(from[0] + dx * step), rounded(from[1] + dy * step)], to: "grid" });
    } else if (page.selected.length) this.nudgeBy([dx * step, dy * step]);
    else page.canvas.pan(-dx * 60, dy * 60);
    return true;
  }

  keyPoint() {
    const at = this.page.layer.cursor?.at ?? this.page.canvas.centre.map((value) => onGrid(value, this.page.step));
    this.showCursor({ at, to: "grid" });
    if (this.page.isReady()) this.add(at);
  }

  // Several presses within a short time are one edit of what is selected then.
  nudgeBy([dx, dy]) {
    const { page } = this;
    if (!page.isReady()) return;
    const before = this.nudge?.delta ?? [0, 0];
    clearTimeout(this.nudge?.timer);
    const delta = [before[0] + dx, before[1] + dy];
    page.layer.ghosts = moveEdits(current(page.selected, page.elements), delta);
    page.canvas.redraw();
    this.nudge = { ids: page.selected, delta, timer: setTimeout(() => this.flush(), NUDGE_MS) };
  }

  // Send the move by keys that waits for more presses; resolves when none is under way.
  flush() {
    const { nudge, page } = this;
    if (!nudge) return this.sending ?? Promise.resolve();
    clearTimeout(nudge.timer);
    this.nudge = null;
    const send = () => page.commit(moveEdits(current(nudge.ids, page.elements), nudge.delta));
    const sending = (this.sending ? this.sending.then(send) : send()).finally(() => {
      if (this.sending === sending) this.sending = null;
    });
    this.sending = sending;
    return sending;
  }
}
