// What has happened, the newest first; a press looks back to the moment before.
import { clockText } from "/static/past.js";

const SIGNS = {
  collision: "\u2715 collision", stop: "\u25a0 stop", mission: "\u25c6 mission", program: "\u25b8 program", robot: "robot",
  server: "\u25b2 server", channel: "\u25b2 channel" };

export default {
  props: { happenings: Array },
  emits: ["look"],
  template: `
    <section aria-label="Events">
      <p v-if="!happenings.length" class="panel-note">nothing yet: stops, programs, missions, collisions appear here</p>
      <p v-else class="panel-note">Press one to look back to the moment before it.</p>
      <ol v-if="happenings.length" class="happenings">
        <li v-for="each in newest" :key="each.at + ' ' + each.number">
          <button type="button" :title="'Look back to just before ' + clock(each.at)" @click="$emit('look', each)">
            <time>{{ clock(each.at) }}</time><span :class="'is-' + each.kind">{{ sign(each.kind) }}</span>
            <span class="happening-text">{{ each.text }}</span>
          </button>
        </li>
      </ol>
    </section>`,
  computed: {
    newest() {
      return this.happenings.slice(-300).reverse();
    },
  },
  methods: {
    clock: clockText,
    sign(kind) {
      return SIGNS[kind] ?? kind;
    },
  },
};
