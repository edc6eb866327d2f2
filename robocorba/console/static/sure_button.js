// A button for what can't be taken back: the first press asks on the button itself, the second one acts.

// How long the question stays [ms].
const SURE_MS = 4000;

export default {
  props: { label: String, question: String, disable: Boolean, title: String },
  emits: ["sure"],
  template: `
    <q-btn dense no-caps :outline="!isAsked" :color="isAsked ? 'negative' : undefined"
           :label="isAsked ? question : label"
           :disable="disable" :title="title" @click="press" />`,
  data() {
    return { isAsked: false };
  },
  unmounted() {
    clearTimeout(this.timer);
  },
  methods: {
    press() {
      clearTimeout(this.timer);
      if (this.isAsked) this.$emit("sure");
      else this.timer = setTimeout(() => { this.isAsked = false; }, SURE_MS);
      this.isAsked = !this.isAsked;
    },
  },
};
