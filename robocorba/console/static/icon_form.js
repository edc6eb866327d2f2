// The parameters of an icon as a form that is made from the JSON schema of programs.
import { live } from "/static/live.js";

// Parameters in radians are entered in degrees.
const DEGREES = 180 / Math.PI;
const POSTURES = ["home", "ready", "reach", "carry", "tuck"];

const Parameters = {
  name: "IconParameters",
  props: { schema: Object, definition: Object, values: Object, names: Object },
  emits: ["change"],
  template: `
    <div class="icon-parameters">
      <template v-for="parameter in parameters" :key="parameter.name">
        <fieldset v-if="parameter.name === 'condition'">
          <legend>condition</legend>
          <label class="icon-field"><span>kind</span>
            <select :value="values.condition?.when" @change="set('condition', { when: $event.target.value })" aria-label="kind of condition">
              <option v-for="when in schema.conditions.keys()" :key="when">{{ when }}</option></select></label>
          <icon-parameters :schema="schema" :definition="schema.conditions.get(values.condition?.when)" :names="names"
                           :values="values.condition" @change="(name, value) => setIn('condition', name, value)"></icon-parameters>
        </fieldset>
        <fieldset v-else-if="parameter.properties">
          <legend>{{ parameter.name }}</legend>
          <icon-parameters :schema="schema" :definition="parameter" :values="values[parameter.name] ?? {}" :names="names"
                           @change="(name, value) => setIn(parameter.name, name, value)"></icon-parameters>
        </fieldset>
        <fieldset v-else-if="parameter.prefixItems">
          <legend>{{ parameter.name }}</legend>
          <label v-for="(item, index) in parameter.prefixItems" :key="index" class="icon-field" :title="range(item)">
            <span>{{ title(item) }}</span>
            <input type="number" step="any" :value="shown(item, values[parameter.name]?.[index])" :aria-label="title(item)"
                   @change="setItem(parameter, index, item, $event.target.value)"></label>
        </fieldset>
        <label v-else class="icon-field" :title="range(parameter)">
          <span>{{ parameter.name }}{{ parameter.isRequired ? "" : " (optional)" }} <small>{{ unit(parameter) }}</small></span>
          <select v-if="choices(parameter)" :value="values[parameter.name] ?? ''" @change="set(parameter.name, $event.target.value)"
                  :aria-label="parameter.name">
            <option value=""></option>
            <option v-for="choice in choices(parameter)" :key="choice">{{ choice }}</option></select>
          <input v-else-if="isNumber(parameter)" type="number" step="any" :value="shown(parameter, values[parameter.name])"
                 :aria-label="parameter.name" @change="set(parameter.name, number(parameter, $event.target.value))">
          <input v-else-if="parameter.type === 'string'" type="text" :value="values[parameter.name] ?? ''" maxlength="200"
                 :aria-label="parameter.name" @change="set(parameter.name, $event.target.value)" :list="'known-' + parameter.name">
          <input v-else type="text" :value="json(values[parameter.name])" :aria-label="parameter.name"
                 @change="setJson(parameter.name, $event.target.value)">
        </label>
      </template>
    </div>`,
  computed: {
    parameters() {
      return this.definition ? this.schema.parameters(this.definition) : [];
    },
  },
  methods: {
    isNumber: (parameter) => parameter.type === "number" || parameter.type === "integer",
    choices(parameter) {
      if (parameter.enum) return parameter.enum;
      if (parameter.name === "floor") return live.names;
      if (parameter.name === "posture") return POSTURES;
      const names = this.names[parameter.name];
      return names?.length ? names : undefined;
    },
    isAngle: (parameter) => (parameter.title ?? "").includes("rad"),
    unit(parameter) {
      return ((parameter.title ?? "").match(/\[(.*)\]/)?.[1] ?? "").replace("rad", "\u00b0");
    },
    title(item) {
      return (item.title ?? "").replace("[rad]", "[\u00b0]");
    },
    range(parameter) {
      const factor = this.isAngle(parameter) ? DEGREES : 1;
      const bound = (value) => (value === undefined ? "" : Number((value * factor).toFixed(2)));
      const text = parameter.description ?? "";
      if (parameter.minimum === undefined && parameter.maximum === undefined) return text;
      return `${text} From ${bound(parameter.minimum ?? parameter.exclusiveMinimum)} to ${bound(parameter.maximum)}.`.trim();
    },
    shown(parameter, value) {
      if (typeof value !== "number") return "";
      return Number((this.isAngle(parameter) ? value * DEGREES : value).toFixed(4));
    },
    number(parameter, text) {
      if (text === "") return undefined;
      return this.isAngle(parameter) ? Number(text) / DEGREES : Number(text);
    },
    json: (value) => (value === undefined ? "" : JSON.stringify(value)),
    set(name, value) {
      this.$emit("change", name, value === "" ? undefined : value);
    },
    setIn(outer, name, value) {
      this.set(outer, { ...this.values[outer], [name]: value });
    },
    setItem(parameter, index, item, text) {
      const items = Array.from({ length: parameter.prefixItems.length }, (_, k) => this.values[parameter.name]?.[k] ?? 0);
      items[index] = this.number(item, text) ?? 0;
      this.set(parameter.name, items);
    },
    setJson(name, text) {
      try {
        this.set(name, text === "" ? undefined : JSON.parse(text));
      } catch {
        this.set(name, text);
      }
    },
  },
};

export const IconForm = {
  components: { IconParameters: Parameters },
  props: { schema: Object, node: Object, names: Object },
  emits: ["change"],
  template: `
    <form class="icon-form" @submit.prevent>
      <h2 class="console-heading">{{ node.icon }}</h2>
      <p class="icon-description">{{ definition.description }}</p>
      <icon-parameters :schema="schema" :definition="definition" :values="node.values" :names="names"
                       @change="(name, value) => $emit('change', name, value)"></icon-parameters>
    </form>`,
  computed: {
    definition() {
      return this.schema.icons.get(this.node.icon);
    },
  },
};
Parameters.components = { IconParameters: Parameters };
