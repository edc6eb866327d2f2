// The programs that a robot's touch panel offers, each on a large button: the loaded one first.
export const PanelChoice = {
  // choices: {programs: names, loaded: a name or ""}. chosen: a name, "" for the loaded one, or null.
  props: { choices: Object, chosen: String },
  emits: ["choose", "close"],
  template: `
    <section class="panel-choice" role="dialog" aria-modal="true" aria-label="Choose a program">
      <header><h2>Choose a program</h2>
        <button aria-label="Close" @click="$emit('close')"><q-icon name="close" /></button></header>
      <div class="panel-list" role="listbox" aria-label="Programs">
        <button v-for="each in rows" :key="each.program" role="option" :aria-selected="each.program === chosen"
                @click="$emit('choose', each.program)"><bdi>{{ each.name }}</bdi>
          <small v-if="!each.program">loaded</small></button>
      </div>
    </section>`,
  computed: {
    rows() {
      const { programs, loaded } = this.choices;
      const first = loaded ? [{ program: "", name: loaded }] : [];
      return [...first, ...programs.map((name) => ({ program: name, name }))];
    },
  },
};
