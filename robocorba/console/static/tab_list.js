// Tabs that arrow keys move between, each with a count if there are any.
export default {
  props: { names: Array, chosen: String, counts: Object, label: String },
  emits: ["choose"],
  template: `
    <div class="console-tabs">
      <div role="tablist" :aria-label="label" @keydown="key">
        <button v-for="name in names" :key="name" type="button" role="tab" :aria-selected="name === chosen"
                :title="name" :tabindex="name === chosen ? 0 : -1" @click="$emit('choose', name)">
          <bdi>{{ name }}</bdi> <small v-if="counts" :title="(counts[name] ?? 0) + ' robots'">{{ counts[name] ?? 0 }}</small>
        </button>
      </div>
      <slot />
    </div>`,
  methods: {
    key(event) {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step || !this.names.length) return;
      const next = (this.names.indexOf(this.chosen) + step + this.names.length) % this.names.length;
      this.$emit("choose", this.names[next]);
      event.currentTarget.querySelectorAll("[role=tab]")[next]?.focus();
      event.preventDefault();
      event.stopPropagation();
    },
  },
};
