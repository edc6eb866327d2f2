// The selected icon: what it does, its parameters, and what is wrong with it.
import { pictureOf, titleOf } from "/static/icon_looks.js";
import { IconParameters } from "/static/icon_parameters.js";

export const IconForm = {
  components: { IconParameters },
  props: { schema: Object, node: Object, choices: Object, problems: Array },
  emits: ["change", "shift", "copy", "paste", "remove"],
  template: `
    <form class="icon-form" @submit.prevent :aria-label="titleOf(node.icon)">
      <div class="icon-top"><h2 class="icon-title"><q-icon :name="pictureOf(node.icon)" size="20px" />
        {{ titleOf(node.icon) }}</h2>
      <div class="icon-tools">
        <q-btn dense flat round size="sm" icon="arrow_upward" aria-label="Move up" title="Move up (Alt+Up)"
               @click="$emit('shift', -1)" />
        <q-btn dense flat round size="sm" icon="arrow_downward" aria-label="Move down" title="Move down (Alt+Down)"
               @click="$emit('shift', 1)" />
        <q-btn dense flat round size="sm" icon="content_copy" aria-label="Copy" title="Copy (Ctrl+C)"
               @click="$emit('copy')" />
        <q-btn dense flat round size="sm" icon="content_paste" aria-label="Paste after it" title="Paste (Ctrl+V)"
               @click="$emit('paste')" />
        <q-btn dense flat round size="sm" icon="delete" aria-label="Remove" title="Remove (Delete)"
               @click="$emit('remove')" />
      </div></div>
      <p class="icon-description" tabindex="0">{{ definition.description.replaceAll("\`", "") }}</p>
      <icon-parameters :key="node.id" :schema="schema" :definition="definition" :values="node.values" :choices="choices"
                       :problems="problems" prefix=""
                       @change="(name, value) => $emit('change', name, value)"></icon-parameters>
      <p v-for="{ kind, parameter, reason } in others" :key="parameter + reason" class="icon-reason"
         :class="'is-' + kind">
        {{ parameter }} {{ reason }}</p>
    </form>`,
  computed: {
    definition() {
      return this.schema.icons.get(this.node.icon);
    },
    // Problems that concern no field, such as those of the icons inside or of the whole icon.
    others() {
      const bodies = this.schema.bodies(this.node.icon);
      return this.problems.filter(({ parameter }) => !parameter || bodies.includes(parameter));
    },
  },
  methods: { pictureOf, titleOf },
};
