// The program as Python and as the JSON of its file.
import TabList from "/static/tab_list.js";

export const ProgramText = {
  components: { TabList },
  props: { json: String, python: String, message: String },
  template: `
    <section class="program-source" aria-label="Program as text">
      <TabList label="Language" :names="['Python', 'JSON']" :chosen="language" @choose="language = $event">
        <q-btn flat dense round size="sm" icon="content_copy" aria-label="Copy the text" :disable="!text"
               @click="copy" />
        <span class="target-help" role="status">{{ note }}</span>
      </TabList>
      <pre v-if="text" class="program-text" tabindex="0" :aria-label="language">{{ text }}</pre>
      <div v-else class="console-message">{{ message }}</div>
    </section>`,
  data() {
    return { language: "Python", note: "" };
  },
  computed: {
    text() {
      return this.language === "Python" ? this.python : this.json;
    },
  },
  methods: {
    async copy() {
      try {
        await navigator.clipboard.writeText(this.text);
        this.note = "copied";
      } catch {
        this.note = "the browser allows no copying; select the text";
      }
    },
  },
};
