// The panel of files: export and import with their losses, and the picture below a floor; and the map page's methods
// for it.
import { download } from "/static/download.js";
import { attempt, call } from "/static/live.js";
import { shown } from "/static/map_form.js";

// Larger files don't fit into a request of 8 MiB.
const MAX_BYTES = 5.5 * 1024 * 1024;

export const FilesPanel = {
  directives: { shown },
  props: { floor: String, version: Number, underlay: Object },
  emits: ["replace", "underlay"],
  template: `
    <div class="map-files">
      <h3 class="console-heading">Export</h3>
      <label class="map-field"><span>format</span><select v-model="format">
        <option v-for="each in formats" :key="each.name" :value="each.name">{{ each.title }}</option></select></label>
      <template v-if="formats.some((each) => each.name === format && each.cells)">
        <label class="map-field"><span>cell <small>m</small></span><input v-model.number="resolution" type="number"
            min="0.01" step="0.01"></label>
        <label class="map-field"><span>picture</span><select
            v-model="image"><option>pgm</option><option>png</option></select></label>
      </template>
      <div class="console-actions"><q-btn dense no-caps color="primary" icon="download" label="Export"
          :loading="isExporting" @click="export_" /></div>
      <div v-if="exported" role="status">
        <p class="map-none">{{ exported.name }} {{ exported.losses.length ? 'lacks:' : 'holds everything.' }}</p>
        <ul class="map-losses"><li v-for="loss in exported.losses">{{ loss }}</li></ul></div>

      <h3 class="console-heading">Import</h3>
      <p class="map-none">A RoboCorba map, an Open-RMF building, or ROS maps with their pictures. It replaces the whole
        building.</p>
      <div class="map-field"><span>files</span><input type="file" multiple
          accept=".yaml,.yml,.json,.pgm,.png,.jpg,.jpeg" aria-label="Map files"
          @change="read($event.target.files)"></div>
      <label class="map-field"><span>unknown cells of ROS maps</span><select v-model="unknown"
          @change="again"><option>blocked</option><option>free</option></select></label>
      <label class="map-field"><span>specks of ROS maps</span><select v-model="specks" @change="again"><option
          value="walls">remove beside walls</option><option value="all">remove all</option><option
          value="keep">keep</option></select></label>
      <label class="map-field"><span>generate roads where there are none</span><input v-model="topology"
          type="checkbox" @change="again"></label>
      <q-linear-progress v-if="busy === 'read'" indeterminate />
      <div v-if="found" role="status">
        <p class="map-none">{{ found.format }}: {{ found.summary }}</p>
        <ul class="map-losses"><li v-for="loss in found.losses">{{ loss }}</li><li
            v-for="warning in found.warnings">warning: {{ warning }}</li></ul>
        <p v-if="!found.losses.length && !found.warnings.length" class="map-none">Nothing is lost.</p>
        <div class="console-actions"><q-btn dense no-caps color="primary" icon="upload" label="Replace the building"
            @click="replace" />
          <q-btn dense no-caps outline label="Cancel" @click="found = null" /></div></div>
      <p v-if="problem" class="map-note" role="alert">{{ problem }}</p>

      <h3 class="console-heading">Picture below floor {{ floor }}</h3>
      <div class="map-field"><span>PNG or JPEG</span><input type="file" accept="image/png,image/jpeg"
          aria-label="Picture below the floor" @change="readPicture($event.target.files[0])"></div>
      <template v-if="underlay">
        <label v-for="[key, title] in placing" :key="key" class="map-field"><span>{{ title }}</span>
          <input v-shown="underlay[key]" type="number" step="any" @change="place(key, $event.target)"></label>
        <div class="console-actions"><q-btn dense no-caps outline icon="delete" label="Remove the picture"
            @click="$emit('underlay', null)" /></div>
      </template>
      <p v-if="pictureProblem" class="map-note" role="alert">{{ pictureProblem }}</p>
    </div>`,
  data() {
    return {
      formats: [], format: "native", resolution: 0.05, image: "pgm", unknown: "blocked", specks: "walls",
      topology: false, busy: "", isExporting: false, exported: null, found: null, problem: "", pictureProblem: "", files: null, turn: 0,
      placing: [["x", "left m"], ["y", "lower edge m"], ["resolution", "m per pixel"]],
    };
  },
  created() {
    attempt(this, async () => { this.formats = await call("map_formats"); });
  },
  methods: {
    async export_() {
      this.exported = null;
      await attempt(this, async () => {
        const argument = { format: this.format, resolution: this.resolution, image: this.image };
        this.exported = await call("map_export", argument);
        download(this.exported.name, bytes(this.exported.content));
      }, { busy: "isExporting" });
    },
    async read(list) {
      const turn = ++this.turn; // answers for files and options of an earlier turn are dropped
      this.files = null;
      this.found = null;
      this.problem = "";
      this.busy = "";
      const files = [...list];
      if (!files.length) return;
      if (files.reduce((sum, file) => sum + file.size, 0) > MAX_BYTES) {
        this.problem = "these files have more than 5.5 MiB; use `robocorba map import` instead";
        return;
      }
      try {
        const contents = await Promise.all(files.map(base64));
        if (turn !== this.turn) return;
        this.files = Object.fromEntries(files.map((file, n) => [file.name, contents[n]]));
      } catch (error) {
        if (turn === this.turn) this.problem = error.message;
        return;
      }
      await this.again();
    },
    async again() {
      if (!this.files) return;
      const turn = ++this.turn;
      const { files, unknown, specks, topology, version } = this;
      Object.assign(this, { busy: "read", found: null, problem: "" });
      const answer = await call("map_read_files", { files, unknown, specks, topology }).then(
        (found) => ({ found, readAt: version }), (error) => ({ problem: error.message }));
      if (turn === this.turn) Object.assign(this, { busy: "", ...answer });
    },
    replace() {
      this.$emit("replace", { document: this.found.document, version: this.readAt });
      this.found = null;
    },
    async readPicture(file) {
      this.pictureProblem = "";
      if (!file) return;
      if (file.size > MAX_BYTES) {
        this.pictureProblem = "the picture has more than 5.5 MiB";
        return;
      }
      const picture = await base64(file).catch((error) => { this.pictureProblem = error.message; });
      if (picture) this.$emit("underlay", { x: 0, y: 0, resolution: 0.05, ...this.underlay, picture });
    },
    place(key, target) {
      if (Number.isFinite(target.valueAsNumber)) this.$emit("underlay", { ...this.underlay,
        [key]: target.valueAsNumber });
      else target.value = this.underlay[key];
    },
  },
};

// Methods of the map page.
export const fileMethods = {
  async replace({ document, version }) {
    const isMade = await this.saved(this.session.changeWhole("map_replace", { document, version }));
    if (isMade) this.say("the building is replaced; undo brings the old one back");
  },
  async loadUnderlay() {
    const floor = this.current;
    this.underlay = null;
    this.canvas.underlay = null;
    try {
      const found = await call("map_underlay", { floor });
      if (floor !== this.current || !found) return;
      this.underlay = found;
      const image = new Image();
      image.src = `data:${found.picture.startsWith("iVBOR") ? "image/png" : "image/jpeg"};base64,${found.picture}`;
      await image.decode();
      const { x, y, resolution } = found;
      if (floor === this.current) this.canvas.underlay = { image, x, y, resolution };
      this.canvas.redraw();
    } catch (error) {
      this.say(`the picture below the floor can't be shown: ${error.message}`, true);
    }
  },
  async setUnderlay(underlay) {
    await call("map_set_underlay", { floor: this.current, ...underlay }).catch((error) => this.say(error.message, true));
    await this.loadUnderlay();
    this.canvas.redraw();
  },
};

function base64(file) {
  return new Promise((resolve, reject) => {
    const reader = new FileReader();
    reader.onload = () => resolve(reader.result.slice(reader.result.indexOf(",") + 1));
    reader.onerror = () => reject(new Error(`${file.name} can't be read`));
    reader.readAsDataURL(file);
  });
}

function bytes(content) {
  return Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
}
