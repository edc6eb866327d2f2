// One parameter as a labelled field with its unit, its range, and what is wrong with it.
import { isAngle, shownNumber } from "/static/icon_problems.js";

const RADIANS = Math.PI / 180;
let lastField = 0;

export const IconField = {
  // choices: known names for a text; others are possible, too, unless `isClosed`.
  props: { parameter: Object, value: null, reasons: Array, choices: Object },
  emits: ["change"],
  template: `
    <div class="icon-field" :class="{ 'is-wrong': reasons.length }">
      <label class="icon-label" :for="id">{{ label }} <small v-if="unit">{{ unit }}</small>
        <small v-if="!parameter.isRequired" class="is-optional">optional</small></label>
      <select v-if="options" :id="id" :value="value ?? ''" :title="help" @change="change($event.target.value)">
        <option value="">{{ parameter.isRequired ? "choose" : "" }}</option>
        <option v-for="option in options" :key="option" :value="option">{{ option.replaceAll("_", " ") }}</option></select>
      <input v-else-if="isNumber" :id="id" type="number" step="any" :value="shown" :title="help" :placeholder="range"
             @change="changeNumber($event.target)">
      <template v-else-if="isText">
        <input :id="id" type="text" maxlength="200" :value="value ?? ''" :title="help" :list="id + '-known'"
               :placeholder="parameter.default ?? ''" @change="change($event.target.value)">
        <datalist :id="id + '-known'"><option v-for="name in choices?.names ?? []" :key="name" :value="name"></option></datalist>
      </template>
      <input v-else :id="id" type="text" :value="json" :title="help" placeholder="any JSON value" @change="changeJson($event.target.value)">
      <p v-for="{ kind, reason } in reasons" :key="reason" class="icon-reason" :class="'is-' + kind">{{ reason }}</p>
    </div>`,
  data() {
    return { id: `icon-field-${++lastField}` };
  },
  computed: {
    label() {
      return this.parameter.name.replaceAll("_", " ");
    },
    isNumber() {
      return this.parameter.type === "number" || this.parameter.type === "integer";
    },
    isText() {
      return this.parameter.type === "string";
    },
    options() {
      const known = this.parameter.enum ?? (this.choices?.isClosed && this.choices.names.length ? this.choices.names : null);
      if (!known || this.value === undefined || this.value === null || known.includes(this.value)) return known;
      return [...known, String(this.value)];
    },
    unit() {
      return ((this.parameter.title ?? "").match(/\[(.*)\]/)?.[1] ?? "").replace("rad", "\u00b0");
    },
    range() {
      const { minimum, exclusiveMinimum, maximum } = this.parameter;
      const least = minimum ?? exclusiveMinimum;
      if (least === undefined || maximum === undefined || maximum >= 1000) return "";
      return `${shownNumber(this.parameter, least)} \u2026 ${shownNumber(this.parameter, maximum)}`;
    },
    help() {
      const text = this.parameter.description ?? "";
      return this.range ? `${text} ${this.range} ${this.unit}`.trim() : text;
    },
    shown() {
      if (typeof this.value !== "number") return "";
      return Number((isAngle(this.parameter) ? this.value / RADIANS : this.value).toFixed(4));
    },
    json() {
      return this.value === undefined ? "" : JSON.stringify(this.value);
    },
  },
  methods: {
    change(value) {
      this.$emit("change", value === "" ? undefined : value);
    },
    changeNumber(input) {
      if (input.value === "") this.$emit("change", undefined);
      else this.$emit("change", Number(input.value) * (isAngle(this.parameter) ? RADIANS : 1));
    },
    changeJson(text) {
      let value = text;
      try {
        value = JSON.parse(text);
      } catch {
        // plain text, then
      }
      this.$emit("change", text === "" ? undefined : value);
    },
  },
};
