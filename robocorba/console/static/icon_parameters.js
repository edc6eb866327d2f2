// Fields for the parameters of an icon, a condition or a place, made from the JSON schema of programs.
import { reasonsAt } from "/static/icon_problems.js";
import { IconField } from "/static/icon_field.js";

export const IconParameters = {
  name: "IconParameters",
  components: { IconField },
  // values: of the parameters. choices: known names by parameter. prefix: of the parameters' names in problems.
  props: { schema: Object, definition: Object, values: Object, choices: Object, problems: Array, prefix: String },
  emits: ["change"],
  template: `
    <div class="icon-parameters">
      <template v-for="parameter in parameters" :key="parameter.name">
        <fieldset v-if="parameter.isCondition">
          <legend>{{ parameter.name }}</legend>
          <icon-field :parameter="kinds" :value="values[parameter.name]?.when" :reasons="reasons(parameter.name)"
                      @change="(when) => set(parameter.name, when && { when })"></icon-field>
          <icon-parameters v-if="schema.conditions.has(values[parameter.name]?.when)" :schema="schema"
                           :definition="schema.conditions.get(values[parameter.name].when)" :choices="choices"
                           :problems="problems" :prefix="prefix + parameter.name + '.'" :values="values[parameter.name]"
                           @change="(name, value) => setIn(parameter.name, name, value)"></icon-parameters>
        </fieldset>
        <fieldset v-else-if="parameter.properties">
          <legend>{{ parameter.name }}</legend>
          <icon-parameters :schema="schema" :definition="parameter" :values="values[parameter.name] ?? {}"
                           :choices="choices"
                           :problems="problems" :prefix="prefix + parameter.name + '.'"
                           @change="(name, value) => setIn(parameter.name, name, value)"></icon-parameters>
        </fieldset>
        <fieldset v-else-if="parameter.prefixItems">
          <legend>{{ parameter.name }}</legend>
          <icon-field v-for="(item, index) in parameter.prefixItems" :key="index"
                      :value="values[parameter.name]?.[index]"
                      :parameter="{ ...item, name: plainTitle(item), isRequired: true }"
                      :reasons="reasons(parameter.name + '[' + index + ']')"
                      @change="(value) => setItem(parameter, index, value)"></icon-field>
          <p v-for="reason in reasons(parameter.name)" :key="reason.reason" class="icon-reason">{{ reason.reason }}</p>
        </fieldset>
        <icon-field v-else :parameter="parameter" :value="values[parameter.name]" :choices="choices[parameter.name]"
                    :reasons="reasons(parameter.name)" @change="(value) => set(parameter.name, value)"></icon-field>
      </template>
      <div v-for="name in unknown" :key="name" class="icon-field">
        <span class="icon-label">{{ name }}</span>
        <q-btn dense flat no-caps label="Remove" @click="set(name, undefined)" />
        <p class="icon-reason">is unknown</p>
      </div>
    </div>`,
  computed: {
    parameters() {
      return this.schema.parameters(this.definition);
    },
    kinds() {
      return { name: "kind", enum: [...this.schema.conditions.keys()], isRequired: true };
    },
    unknown() {
      const known = new Set(this.parameters.map((parameter) => parameter.name));
      return Object.keys(this.values ?? {}).filter((name) => !known.has(name) && name !== "when");
    },
  },
  methods: {
    reasons(name) {
      return reasonsAt(this.problems, this.prefix + name);
    },
    plainTitle: (item) => (item.title ?? "").replace(/\s*\[.*\]/, ""),
    set(name, value) {
      this.$emit("change", name, value);
    },
    setIn(outer, name, value) {
      const inner = { ...this.values[outer], [name]: value };
      if (value === undefined) delete inner[name];
      this.set(outer, inner);
    },
    setItem(parameter, index, value) {
      const before = this.values[parameter.name];
      const items = Array.from({ length: parameter.prefixItems.length }, (_, k) => before?.[k] ?? null);
      items[index] = value ?? null;
      this.set(parameter.name, items.every((item) => item === null) ? undefined : items);
    },
  },
};
IconParameters.components.IconParameters = IconParameters;
