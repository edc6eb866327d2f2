// Says on a scene that it shows the past, which moment, and what of it is of today; its button goes back to now.
import { BEFORE_S, clockText } from "/static/past.js";

export default {
  props: { past: Object, events: Array, more: String },
  emits: ["live"],
  template: `
    <div class="scene-note past-note">
      <q-btn dense no-caps color="primary" label="Live" aria-label="Live: show what happens now"
             title="Show what happens now" @click="$emit('live')" />
      <span><strong>{{ past.recording ? "recording" : "the past" }}: {{ clock }}</strong>
        <small>{{ notes }}</small></span>
      <span v-if="last" class="past-event">{{ last }}</span>
    </div>`,
  computed: {
    clock() {
      return this.past.at ? clockText(this.past.at) : "";
    },
    notes() {
      return [this.past.recording ? "" : "on the map of today", this.more].filter(Boolean).join("; ");
    },
    last() {
      const { at, recording } = this.past;
      if (recording || !at) return "";
      return this.events.filter((each) => each.at <= at && each.at > at - BEFORE_S).pop()?.text ?? "";
    },
  },
};
