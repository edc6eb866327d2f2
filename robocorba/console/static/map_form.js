// A form with all members of an element, made from the description that the server gives of each kind.
import { copyOf } from "/static/map_model.js";

const DEGREES = 180 / Math.PI;
const NEW_SHAPES = {
  segment: { kind: "segment", length: 1 }, box: { kind: "box", size: [1, 1] }, circle: { kind: "circle", radius: 0.5 },
  polygon: { kind: "polygon", points: [[0, 0], [1, 0], [0, 1]] },
};

const isSame = (field, one, other) => (field.type === "number"
  ? one === "" || Number(one) === Number(other) : one.trim() === other);

// v-shown: the value of a field, which does not replace what a user is typing there: edits of others come in meanwhile.
// Such a field then takes their value and emits "overtaken" instead of "change".
export const shown = {
  mounted(field, { value }) {
    field.value = field.shownText = field.latestText = String(value);
    field.sent = []; // what was typed, until it is the value
    field.addEventListener("change", (event) => {
      const typed = field.value, latest = field.latestText;
      const isEdit = !isSame(field, typed, field.sent.at(-1) ?? field.shownText);
      if (isEdit && latest === field.shownText) {
        field.sent.push(typed);
        return;
      }
      event.stopImmediatePropagation();
      field.shownText = latest;
      field.value = field.sent.at(-1) ?? latest;
      if (isEdit) field.dispatchEvent(new CustomEvent("overtaken", { bubbles: true, detail: { typed, latest } }));
    }, { capture: true });
  },
  updated(field, { value }) {
    const text = String(value);
    if (text !== field.latestText && field.sent.length) {
      const answered = field.sent.splice(0, field.sent.indexOf(text) + 1 || 1).pop();
      if (field.value === answered) field.value = text;
      field.shownText = text;
    }
    field.latestText = text;
    const isTyped = field === document.activeElement && field.value !== field.shownText;
    if (!isTyped || field.value === text) field.value = field.shownText = text;
  },
};

const Members = {
  name: "MapMembers",
  directives: { shown },
  props: { members: Array, values: Object, names: Object, skip: Array },
  emits: ["change"],
  template: `
    <div class="map-members">
      <template v-for="member in shown" :key="member.name">
        <fieldset v-if="member.type === 'variants'">
          <legend>{{ label(member) }}</legend>
          <label class="map-field"><span>kind</span>
            <select :value="values[member.name].kind" aria-label="kind of shape"
                @change="set(member.name, newShape($event.target.value))">
              <option v-for="(_, kind) in member.variants" :key="kind">{{ kind }}</option></select></label>
          <map-members :members="member.variants[values[member.name].kind]" :values="values[member.name]" :names="names"
                       @change="(name, value) => setIn(member.name, name, value)"></map-members>
        </fieldset>
        <fieldset v-else-if="member.type === 'rows'">
          <legend>{{ label(member) }}</legend>
          <div v-for="(row, n) in values[member.name]" :key="n" class="map-row">
            <map-members :members="member.members" :values="row" :names="names"
                         @change="(name, value) => setRow(member.name, n, { ...row, [name]: value })"></map-members>
            <q-btn flat dense round size="sm" icon="delete" :aria-label="'Remove ' + label(member) + ' ' + (n + 1)"
                   @click="setRow(member.name, n, null)" />
          </div>
          <q-btn flat dense no-caps size="sm" icon="add" label="add" @click="addRow(member)" />
        </fieldset>
        <fieldset v-else-if="member.type === 'points'">
          <legend>{{ label(member) }} <small>{{ member.unit }}</small></legend>
          <div v-for="(point, n) in values[member.name]" :key="n" class="map-point">
            <small>{{ n + 1 }}</small>
            <input v-for="axis in [0, 1]" :key="axis" v-shown="point[axis]" type="number" step="any"
                :aria-label="label(member) + ' ' + (n + 1) + ' ' + 'xy'[axis]"
                   @change="setPoint(member.name, n, axis, $event)">
            <q-btn flat dense round size="sm" icon="delete" :aria-label="'Remove point ' + (n + 1)"
                @click="removePoint(member.name, n)" />
          </div>
          <small v-if="!values[member.name].length" class="map-none">none: draw it with the tool</small>
        </fieldset>
        <label v-else class="map-field">
          <span>{{ label(member) }} <small>{{ unit(member) }}</small></span>
          <span v-if="member.type === 'point'" class="map-pair">
            <input v-for="axis in [0, 1]" :key="axis" v-shown="values[member.name][axis]" type="number" step="any"
                :aria-label="label(member) + ' ' + 'xy'[axis]"
                   @change="setAxis(member.name, axis, $event)"></span>
          <input v-else-if="member.type === 'boolean'" type="checkbox" :checked="values[member.name]"
              @change="set(member.name, $event.target.checked)">
          <select v-else-if="choices(member)" :value="values[member.name]"
              @change="set(member.name, $event.target.value)">
            <option v-for="choice in choices(member)" :key="choice"
                :value="choice">{{ choice || 'none' }}</option></select>
          <input v-else-if="member.type === 'number' || member.type === 'integer'" v-shown="shownNumber(member)"
              type="number" :step="member.type === 'integer' ? 1 : 'any'" @change="setNumber(member, $event)">
          <input v-else-if="member.type === 'names'" v-shown="values[member.name].join(', ')" type="text"
              placeholder="names, with commas"
                 @change="set(member.name, split($event.target.value))">
          <input v-else v-shown="values[member.name]" type="text" maxlength="200"
              @change="set(member.name, $event.target.value)">
        </label>
      </template>
    </div>`,
  computed: {
    shown() {
      return this.members.filter((member) => !this.skip?.includes(member.name)
        && this.values[member.name] !== undefined);
    },
  },
  methods: {
    label: (member) => member.name.replaceAll("_", " "),
    unit: (member) => (member.unit === "rad" ? "\u00b0" : member.unit),
    choices(member) {
      if (member.type === "choice") return member.choices;
      if (member.type !== "reference") return undefined;
      const known = this.names[member.of] ?? [];
      const value = this.values[member.name];
      return [...new Set([...(member.default === "" ? [""] : []), ...known, value])];
    },
    shownNumber(member) {
      const value = this.values[member.name];
      return Number((member.unit === "rad" ? value * DEGREES : value).toFixed(6));
    },
    newShape: (kind) => copyOf(NEW_SHAPES[kind]),
    split: (text) => text.split(",").map((name) => name.trim()).filter(Boolean),
    set(name, value) {
      this.$emit("change", name, value);
    },
    setNumber(member, { target }) {
      if (target.value === "" || !Number.isFinite(target.valueAsNumber)) target.value = this.shownNumber(member);
      else this.set(member.name, member.unit === "rad" ? target.valueAsNumber / DEGREES : target.valueAsNumber);
    },
    setAxis(name, axis, { target }) {
      const value = [...this.values[name]];
      if (!Number.isFinite(target.valueAsNumber)) target.value = value[axis];
      else {
        value[axis] = target.valueAsNumber;
        this.set(name, value);
      }
    },
    setPoint(name, n, axis, { target }) {
      const points = copyOf(this.values[name]);
      if (!Number.isFinite(target.valueAsNumber)) target.value = points[n][axis];
      else {
        points[n][axis] = target.valueAsNumber;
        this.set(name, points);
      }
    },
    removePoint(name, n) {
      this.set(name, this.values[name].filter((_, index) => index !== n));
    },
    setIn(outer, name, value) {
      this.set(outer, { ...this.values[outer], [name]: value });
    },
    setRow(name, n, row) {
      const rows = this.values[name].map((each, index) => (index === n ? row : each));
      this.set(name, rows.filter(Boolean));
    },
    addRow(member) {
      const rows = this.values[member.name];
      const used = new Set(rows.map((row) => row.floor));
      const floor = this.names.floor.find((name) => !used.has(name)) ?? this.names.floor[0];
      const last = rows[rows.length - 1] ?? { side: "front", width: 1, offset: 0 };
      this.set(member.name, [...rows, { ...last, floor }]);
    },
  },
};
Members.components = { MapMembers: Members };

// Emits change(name of the member, value) and rename(name).
export const MapForm = {
  components: { MapMembers: Members },
  directives: { shown },
  props: { forms: Object, record: Object, names: Object, note: String },
  emits: ["change", "rename"],
  template: `
    <form class="map-form" @submit.prevent>
      <p v-if="note" class="map-note" role="alert">{{ note }}</p>
      <label class="map-field"><span>name</span>
        <input v-shown="record.name" type="text" maxlength="200" @change="rename($event)"></label>
      <map-members :members="forms[record.kind]" :values="record.members" :names="names" :skip="['name']"
          @change="(name, value) => $emit('change', name, value)"></map-members>
    </form>`,
  methods: {
    rename({ target }) {
      const name = target.value.trim();
      if (!name || name === this.record.name) target.value = this.record.name;
      else this.$emit("rename", name);
    },
  },
};
