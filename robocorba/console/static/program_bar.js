// The program's name, undo, files and examples, and the verdict of the check.

export const ProgramBar = {
  // verdict: {text, isProblem, isOk}
  props: { name: String, canUndo: Boolean, canRedo: Boolean, verdict: Object, examples: Array, robotProgram: String },
  emits: ["rename", "undo", "redo", "clear", "open", "save", "example", "take"],
  template: `
    <div class="program-bar" role="toolbar" aria-label="Program">
      <input class="program-name" :value="draft ?? name" aria-label="Name of the program" maxlength="200"
             @input="draft = $event.target.value" @change="rename($event.target.value)" @blur="draft = null">
      <q-btn flat dense round icon="undo" aria-label="Undo" title="Undo (Ctrl+Z)" :disable="!canUndo"
             @click="$emit('undo')" />
      <q-btn flat dense round icon="redo" aria-label="Redo" title="Redo (Ctrl+Y)" :disable="!canRedo"
             @click="$emit('redo')" />
      <q-btn flat dense round icon="note_add" aria-label="New program" title="New program" @click="$emit('clear')" />
      <q-btn flat dense round icon="file_open" aria-label="Open a program file" title="Open a program file"
             @click="$refs.file.click()" />
      <q-btn flat dense round icon="download" aria-label="Save as a file" title="Save as a file (Ctrl+S)"
             @click="$emit('save')" />
      <input ref="file" type="file" accept=".json,application/json" hidden @change="open">
      <select class="program-examples" aria-label="Open an example" @change="example($event.target)">
        <option value="">examples</option>
        <option v-if="robotProgram" value="robot">what {{ robotProgram }} has loaded</option>
        <option v-for="each in examples" :key="each" :value="'example ' + each">{{ each }}</option></select>
      <span class="program-verdict" :class="{ 'is-problem': verdict.isProblem }" role="status" :title="verdict.text">
        <q-icon v-if="verdict.text" :name="verdict.isProblem ? 'warning' : verdict.isOk ? 'check_circle' : 'more_horiz'"
                size="18px" />
        {{ verdict.text }}</span>
    </div>`,
  data() {
    return { draft: null }; // what is being typed; news of the robot must not replace it
  },
  methods: {
    rename(name) {
      this.draft = null;
      this.$emit("rename", name);
    },
    open(event) {
      const [file] = event.target.files;
      if (file) this.$emit("open", file);
      event.target.value = "";
    },
    example(select) {
      if (select.value === "robot") this.$emit("take");
      else if (select.value) this.$emit("example", select.value.replace("example ", ""));
      select.value = "";
    },
  },
};
