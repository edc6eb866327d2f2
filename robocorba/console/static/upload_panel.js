// Uploads the program to the agent on a robot's own computer, which runs it without this one, and shows its reports.
import { plainWords } from "/static/icon_looks.js";
import { call } from "/static/live.js";
import { AddressFields, isAddress, lastAddress, rememberAddress } from "/static/robot_address.js";
import { shortened, whenText } from "/static/texts.js";

const PURPOSE = "upload", WHAT = "the robot's computer", SHOWN = 5;

export const UploadPanel = {
  components: { AddressFields },
  // robot: who has checked the program; json: its text. canRun: it can run there.
  props: { robot: String, program: String, json: String, canRun: Boolean },
  emits: ["close"],
  template: `
    <section class="upload-panel" aria-label="Upload to the robot's computer" @keydown.esc="$emit('close')">
      <p>The program goes to the agent on the robot's own computer, which keeps it, runs it without this computer, and
        reports.</p>
      <address-fields :address="address" :what="what"></address-fields>
      <q-btn dense no-caps outline label="Test" :loading="doing === 'test'" :disable="!canAsk" @click="test" />
      <q-btn dense no-caps color="warning" text-color="black" :loading="doing === 'run'" :disable="!canAsk || !canRun"
             :label="'Upload and run \u201c' + shortened(program, 30) + '\u201d'" @click="upload(true)" />
      <q-btn dense no-caps outline label="Upload only" :loading="doing === 'upload'" :disable="!canAsk || !canRun"
             @click="upload(false)" />
      <q-btn dense no-caps flat label="Close" @click="$emit('close')" />
      <p v-if="problem" class="icon-reason is-error" role="alert">{{ problem }}</p>
      <p v-else-if="text" role="status">{{ text }}</p>
      <ul v-if="reports.length" aria-label="Reports">
        <li v-for="each in reports" :key="each.number">{{ lineOf(each) }}</li></ul>
    </section>`,
  data() {
    return { address: lastAddress(PURPOSE), what: WHAT, doing: "", problem: "", text: "", reports: [] };
  },
  computed: {
    canAsk() {
      return !this.doing && isAddress(this.address);
    },
  },
  methods: {
    shortened,
    lineOf({ number, ended, program }) {
      const when = whenText(ended), where = program.icon ? ` at ${program.icon}` : "";
      const why = program.reason ? `: ${plainWords(program.reason)}` : "";
      const count = program.icons_done === 1 ? "1 icon" : `${program.icons_done} icons`;
      return `${number}  ${when}  ${program.name}: ${program.result}${where}, ${count} done${why}`;
    },
    async attempt(doing, operation, argument) {
      const host = this.address.host.trim(), port = Number(this.address.port);
      this.doing = doing;
      this.problem = this.text = "";
      const answer = await call(operation, { host, port, ...argument }).catch((error) => {
        this.problem = plainWords(error.message);
      });
      if (!this.problem) rememberAddress(PURPOSE, this.address);
      this.doing = "";
      return answer;
    },
    async test() {
      const found = await this.attempt("test", "reach_computer");
      if (!found) return;
      const sensors = found.sensors.length ? `sensors ${found.sensors.join(", ")}` : "no range sensors";
      this.text = `${found.name} answers: adaptor ${found.adaptor}, ${sensors}, ${found.display}`;
      this.reports = found.reports.slice(-SHOWN).reverse();
    },
    async upload(isRun) {
      const argument = { robot: this.robot, program: this.json, run: isRun };
      const found = await this.attempt(isRun ? "run" : "upload", "upload_program", argument);
      if (found) this.text = `${found.name} has upload ${found.number}${isRun ? " and runs it" : ""}; Test shows its report`;
    },
  },
};
