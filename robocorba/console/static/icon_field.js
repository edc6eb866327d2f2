// One parameter as a labelled field with its unit, its range, and what is wrong with it.
import { isAngle, rangeText, unitOf } from "/static/icon_problems.js";

const RADIANS = Math.PI / 180;
// Bounds from here on are not shown before something is out of range.
const ENDLESS = 3600;
let lastField = 0;

export const IconField = {
  // choices: known names for a text; others are possible, too, unless `isClosed`.
  props: { parameter: Object, value: null, reasons: Array, choices: Object },
  emits: ["change"],
  template: `
    <div class="icon-field" :class="{ 'is-wrong': reasons.length, 'is-refused': isRefused }">
      <label class="icon-label" :for="id">{{ label }} <small v-if="unit || range">{{ range || unit }}</small>
        <small v-if="!parameter.isRequired">optional</small>
        <small v-if="isMissing" class="is-missing">is missing</small></label>
      <select v-if="options" :id="id" :value="value ?? ''" :title="help" @change="change($event.target.value)">
        <option value="">{{ parameter.isRequired ? "choose" : "" }}</option>
        <option v-for="option in options" :key="option"
                :value="option">{{ option.replaceAll("_", " ") }}</option></select>
      <input v-else :id="id" type="text" :inputmode="isNumber ? 'decimal' : null" :maxlength="isText ? 200 : null"
             :value="draft ?? shown"
             :title="help" :placeholder="placeholder" :list="names.length ? id + '-known' : null"
             @input="type($event.target.value)" @blur="draft = null">
      <datalist v-if="names.length" :id="id + '-known'">
        <option v-for="name in names" :key="name" :value="name"></option></datalist>
      <p v-for="{ kind, reason } in others" :key="reason" class="icon-reason" :class="'is-' + kind">{{ reason }}</p>
    </div>`,
  data() {
    return { id: `icon-field-${++lastField}`, draft: null };
  },
  computed: {
    label() {
      return this.parameter.name.replaceAll("_", " ");
    },
    isMissing() {
      return this.reasons.some(({ reason }) => reason === "is missing");
    },
    isRefused() {
      return this.reasons.some(({ kind }) => kind === "error");
    },
    others() {
      return this.reasons.filter(({ reason }) => reason && reason !== "is missing");
    },
    isNumber() {
      return this.parameter.type === "number" || this.parameter.type === "integer";
    },
    isText() {
      return this.parameter.type === "string";
    },
    options() {
      const names = this.choices?.isClosed && this.choices.names.length ? this.choices.names : null;
      const known = this.parameter.enum ?? names;
      if (!known || this.value === undefined || this.value === null || known.includes(this.value)) return known;
      return [...known, String(this.value)];
    },
    unit() {
      return unitOf(this.parameter);
    },
    // The range with its unit; it stays beside the name while one types.
    range() {
      return this.isNumber ? rangeText(this.parameter, ENDLESS) : "";
    },
    help() {
      return `${this.parameter.description ?? ""} ${this.range}`.trim();
    },
    placeholder() {
      if (this.isNumber) return "";
      return this.isText ? this.parameter.default ?? "" : "any JSON value";
    },
    names() {
      return (this.isText && this.choices?.names) || [];
    },
    shown() {
      if (this.value === undefined || this.value === null) return "";
      if (this.isText || (this.isNumber && typeof this.value === "string")) return this.value;
      if (typeof this.value !== "number" || !this.isNumber) return JSON.stringify(this.value);
      return Number((isAngle(this.parameter) ? this.value / RADIANS : this.value).toFixed(4));
    },
  },
  methods: {
    // While one types, the field shows what was typed, not the value that was made of it.
    type(text) {
      this.draft = text;
      this.change(this.isNumber ? this.number(text.trim()) : this.read(text));
    },
    // What is no number stays as it is, so that it is reported; a comma is a decimal point.
    number(text) {
      const number = Number(text.replace(/^([^,]*),([^,]*)$/, "$1.$2"));
      return text && Number.isFinite(number) ? number * (isAngle(this.parameter) ? RADIANS : 1) : text;
    },
    read(text) {
      if (this.isText || !text) return text;
      try {
        return JSON.parse(text);
      } catch {
        return text;
      }
    },
    change(value) {
      this.$emit("change", value === "" ? undefined : value);
    },
  },
};
