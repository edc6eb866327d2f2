// What has happened, the newest first, those of a mission together; a press looks back to the moment before.
import { foldedByMission, wantedOf } from "/static/happening_feed.js";
import { clockText } from "/static/past.js";

const SIGNS = {
  collision: "\u2715 collision", stop: "\u25a0 stop", mission: "\u25c6 mission", program: "\u25b8 program", robot: "robot",
  server: "\u25b2 server", channel: "\u25b2 channel" };
// At most this many are listed, the newest ones.
const MOST = 300;

export default {
  props: { happenings: Array, isKnown: Boolean },
  emits: ["look"],
  template: `
    <section aria-label="Events">
      <p v-if="!happenings.length" class="panel-note">{{ isKnown
        ? "nothing yet: stops, programs, missions, collisions appear here" : "connecting" }}</p>
      <div v-else class="happening-filter">
        <select v-model="kind" aria-label="Kind of events"><option value="">all events</option>
          <option v-for="(sign, each) in signs" :key="each" :value="each">{{ sign }}</option></select>
        <input v-model="words" type="search" placeholder="search" aria-label="Search events"></div>
      <ol v-if="happenings.length" class="happenings">
        <li v-for="each in rows" :key="each.at + ' ' + each.number" :class="{ 'is-inner': each.isInner }">
          <button type="button" :title="'Look back to just before ' + clock(each.at)" @click="$emit('look', each)">
            <time>{{ clock(each.at) }}</time><span :class="'is-' + each.kind">{{ signs[each.kind] ?? each.kind }}</span>
            <span class="happening-text">{{ each.text }}</span>
          </button>
          <button v-if="each.inner?.length" type="button" class="happening-more" :aria-expanded="open[each.mission]"
                  @click="open[each.mission] = !open[each.mission]">{{ each.inner.length }} earlier of this mission</button>
        </li>
        <li v-if="!rows.length" class="panel-note">no event has this</li>
      </ol>
    </section>`,
  data() {
    return { signs: SIGNS, kind: "", words: "", open: {} };
  },
  computed: {
    rows() {
      const newest = wantedOf(this.happenings, this.kind, this.words).slice(-MOST).reverse();
      const unfold = (row) => (this.open[row.mission] ? row.inner : []).map((each) => ({ ...each, isInner: true }));
      return foldedByMission(newest).flatMap((row) => [row, ...unfold(row)]);
    },
  },
  methods: {
    clock: clockText,
  },
};
