// The selected icon: what it does, its parameters, and what is wrong with it.
import { pictureOf, titleOf } from "/static/icon_looks.js";
import { IconParameters } from "/static/icon_parameters.js";

const TOOLS = [
  ["arrow_upward", "Move up", "Alt+Up", "shift", -1], ["arrow_downward", "Move down", "Alt+Down", "shift", 1],
  ["content_copy", "Copy", "Ctrl+C", "copy"], ["content_paste", "Paste after it", "Ctrl+V", "paste"],
  ["delete", "Remove", "Delete", "remove"],
];

export const IconForm = {
  components: { IconParameters },
  props: { schema: Object, node: Object, choices: Object, problems: Array },
  emits: ["change", "shift", "copy", "paste", "remove"],
  template: `
    <form class="icon-form" @submit.prevent :aria-label="titleOf(node.icon)">
      <div class="icon-top"><h2 class="icon-title"><q-icon :name="pictureOf(node.icon)" size="20px" />
        {{ titleOf(node.icon) }}</h2>
      <div class="icon-tools">
        <q-btn v-for="[icon, label, keys, ...event] in tools" :key="icon" dense flat round size="sm" :icon="icon"
               :aria-label="label" :title="label + ' (' + keys + ')'" @click="$emit(...event)" />
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
    tools: () => TOOLS,
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
