// A list of icons of a program, with the lists inside of them. Icons are dragged, or moved by the keyboard.
import { summary } from "/static/program_model.js";

export const LOOKS = {
  mbase_path: "route", mbase_to: "near_me", mbase_by: "open_with", mbase_velocity: "speed", mhand_joints: "tune",
  mhand_pose: "back_hand", mhand_offset: "swipe", mhand_posture: "accessibility_new", lumbar: "airline_seat_recline_normal",
  gripper: "pinch", wait_until: "hourglass_top", stop_if_closer: "sensors", wait: "schedule", repeat: "repeat",
  branch: "call_split", say: "campaign", move_table: "table_restaurant", hand_over: "handshake",
};
const LIST_NAMES = { icons: "", then: "then", otherwise: "otherwise" };

export const IconList = {
  name: "IconList",
  props: { list: Array, parentId: [Number, null], listName: String, editor: Object },
  template: `
    <ol class="icon-list" :aria-label="label" @dragover.prevent.stop="over($event, list.length)" @drop.prevent.stop="drop($event, list.length)">
      <li v-for="(node, index) in list" :key="node.id">
        <div class="icon-gap" :class="{ 'is-target': isTarget(index) }" @dragover.prevent.stop="over($event, index)"
             @drop.prevent.stop="drop($event, index)"></div>
        <div class="icon-card" tabindex="0" draggable="true" :data-icon="node.icon" :data-id="node.id"
             :class="{ 'is-selected': node.id === editor.selectedId, 'is-incomplete': editor.problems(node).length,
                       'is-running': node.id === editor.runningId, 'is-done': editor.doneIds.has(node.id) }"
             :aria-label="node.icon + ' ' + text(node)" @click.stop="editor.select(node.id)" @focus="editor.select(node.id)"
             @keydown="editor.key($event, node)" @dragstart.stop="editor.drag($event, node)" @dragend="editor.drop()"
             @dragover.prevent.stop="over($event, index + ($event.offsetY > 18 ? 1 : 0))"
             @drop.prevent.stop="drop($event, editor.target?.index ?? index)">
          <q-icon :name="look(node)" size="20px" /> <b>{{ node.icon }}</b> <span class="icon-text">{{ text(node) }}</span>
          <span v-if="editor.problems(node).length" class="icon-problem" :title="editor.problems(node).join('; ')">
            <q-icon name="warning" size="18px" /> {{ editor.problems(node)[0] }}</span>
        </div>
        <div v-for="(body, name) in node.bodies" :key="name" class="icon-body">
          <span v-if="names[name]" class="icon-body-name">{{ names[name] }}</span>
          <icon-list :list="body" :parent-id="node.id" :list-name="name" :editor="editor"></icon-list>
        </div>
      </li>
      <li class="icon-end" :class="{ 'is-target': isTarget(list.length), 'is-empty': !list.length }">{{ list.length ? "" : "drop icons here" }}</li>
    </ol>`,
  data() {
    return { names: LIST_NAMES };
  },
  computed: {
    label() {
      return this.parentId === null ? "Program" : this.listName;
    },
  },
  methods: {
    text: summary,
    look(node) {
      return LOOKS[node.icon];
    },
    isTarget(index) {
      const target = this.editor.target;
      return target && target.parentId === this.parentId && target.name === this.listName && target.index === index;
    },
    over(event, index) {
      this.editor.over(this.parentId, this.listName, index);
    },
    drop(event, index) {
      this.editor.over(this.parentId, this.listName, index);
      this.editor.drop(event);
    },
  },
};
