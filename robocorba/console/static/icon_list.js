// A list of icons of a program, with the lists inside of them. Icons are dragged, or moved by the keyboard.
import { pictureOf, summary, titleOf } from "/static/icon_looks.js";

// Lines of problems that a card shows at most.
const MAX_LINES = 4;
const WORDS = { incomplete: "incomplete", invalid: "not valid", error: "not possible", note: "note" };
const SIGNS = { incomplete: "edit_note", invalid: "edit_note", error: "warning", note: "info" };
const LIST_NAMES = { icons: "", then: "then", otherwise: "otherwise" };

// `editor` has the state of the page and takes what the user does: see program.js.
export const IconList = {
  name: "IconList",
  props: { list: Array, parentId: [Number, null], listName: String, editor: Object },
  template: `
    <ol class="icon-list" :aria-label="label" @dragover.prevent.stop="over(list.length)"
        @drop.prevent.stop="editor.drop($event)">
      <li v-for="(node, index) in list" :key="node.id" @dragover.prevent.stop="over(half($event, index))"
          @drop.prevent.stop="editor.drop($event)">
        <div class="icon-gap" :class="{ 'is-target': isTarget(index) }"></div>
        <div class="icon-card" tabindex="0" role="button" draggable="true" :data-icon="node.icon" :data-id="node.id"
             :class="classes(node)" :aria-label="description(node)" :aria-pressed="node.id === editor.selectedId"
             @click.stop="editor.select(node.id)" @focus="editor.select(node.id)" @keydown="editor.key($event, node)"
             @dragstart.stop="editor.drag($event, node)" @dragend="editor.drop()">
          <div class="icon-line">
            <small class="icon-number">{{ index + 1 }}</small>
            <q-icon :name="pictureOf(node.icon)" size="20px" />
            <b>{{ titleOf(node.icon) }}</b> <span class="icon-text">{{ summary(node) }}</span>
            <span v-if="word(node)" class="icon-word">{{ word(node) }}</span>
          </div>
          <div v-for="(line, number) in lines(node)" :key="number" class="icon-problem" :class="'is-' + line.kind">
            <q-icon :name="signs[line.kind]" size="16px" />
            <span><b>{{ words[line.kind] }}:</b> {{ line.text }}</span>
          </div>
        </div>
        <div v-for="(body, name) in node.bodies" :key="name" class="icon-body">
          <span v-if="names[name]" class="icon-body-name">{{ names[name] }}</span>
          <icon-list :list="body" :parent-id="node.id" :list-name="name" :editor="editor"></icon-list>
        </div>
      </li>
      <li class="icon-end" :class="{ 'is-target': isTarget(list.length), 'is-empty': !list.length }">
        <button type="button" class="icon-here" :aria-pressed="isPlace"
                @click.stop="editor.setPlace(parentId, listName)">
          {{ isPlace && list.length ? "the next icon comes here" : list.length ? "add here" : empty }}</button>
      </li>
    </ol>`,
  data() {
    return { names: LIST_NAMES, words: WORDS, signs: SIGNS };
  },
  computed: {
    label() {
      return this.parentId === null ? "Program" : this.names[this.listName] || "icons inside";
    },
    isPlace() {
      const { place } = this.editor;
      return Boolean(place && place.parentId === this.parentId && place.name === this.listName);
    },
    empty() {
      if (this.isPlace) return "the next icon comes here: click one of the palette";
      if (this.parentId === null) return "drag icons here, or click them";
      return "drag icons here, or click here and then icons";
    },
  },
  methods: {
    summary,
    pictureOf,
    titleOf,
    lines(node) {
      const lines = this.editor.lines(node.id);
      if (lines.length <= MAX_LINES) return lines;
      const more = lines.length - MAX_LINES + 1;
      return [...lines.slice(0, MAX_LINES - 1), { kind: lines[MAX_LINES - 1].kind, text: `and ${more} more` }];
    },
    classes({ id }) {
      const { run } = this.editor;
      const kinds = new Set(this.editor.lines(id).map((line) => line.kind));
      return {
        "is-selected": id === this.editor.selectedId,
        "is-incomplete": kinds.has("incomplete") || kinds.has("invalid"),
        "is-refused": kinds.has("error"),
        "is-running": id === run.runningId,
        "is-holder": run.holderIds.has(id),
        "is-done": run.doneIds.has(id),
        "is-failed": id === run.failedId,
      };
    },
    word({ id }) {
      const { run } = this.editor;
      if (id === run.runningId) return run.condition === "paused" ? "paused" : "running";
      if (id === run.failedId) return run.report.result;
      return run.doneIds.has(id) ? "done" : "";
    },
    description(node) {
      const problems = this.lines(node).map((line) => `${WORDS[line.kind]}: ${line.text}`);
      return [titleOf(node.icon), summary(node), this.word(node), ...problems].filter(Boolean).join(", ");
    },
    isTarget(index) {
      const { target } = this.editor;
      return target && target.parentId === this.parentId && target.name === this.listName && target.index === index;
    },
    // Above the middle of a card is before its icon, below is behind it.
    half(event, index) {
      const box = event.currentTarget.querySelector(".icon-card").getBoundingClientRect();
      return event.clientY > box.top + box.height / 2 ? index + 1 : index;
    },
    over(index) {
      this.editor.over(this.parentId, this.listName, index);
    },
  },
};
IconList.components = { IconList };
