// The icons that there are: click or press Enter to add one after the selected icon, or drag it into the program.
import { groupsOf, pictureOf, titleOf } from "/static/icon_looks.js";

export const IconPalette = {
  props: { schema: Object },
  emits: ["add", "drag", "dropped"],
  template: `
    <aside class="program-palette" aria-label="Icons">
      <template v-for="[title, icons] in groups" :key="title">
        <h2 class="console-heading">{{ title }}</h2>
        <button v-for="icon in icons" :key="icon" class="palette-icon" draggable="true" :data-icon="icon"
                :title="description(icon)" @click="$emit('add', icon)"
                @dragstart="drag($event, icon)" @dragend="$emit('dropped')">
          <q-icon :name="pictureOf(icon)" size="18px" /> <span>{{ titleOf(icon) }}</span></button>
      </template>
    </aside>`,
  computed: {
    groups() {
      return groupsOf(this.schema);
    },
  },
  methods: {
    pictureOf,
    titleOf,
    description(icon) {
      return this.schema.icons.get(icon).description?.replaceAll("`", "") ?? "";
    },
    drag(event, icon) {
      event.dataTransfer.setData("text/plain", icon);
      event.dataTransfer.effectAllowed = "copy";
      this.$emit("drag", icon);
    },
  },
};
