// Looks back: pause, a timeline of the last half hour or of a recording, playing it, and films of a span.
import { attempt, call, live } from "/static/live.js";
import { clockText, failure, pastFloors } from "/static/past.js";
import { rememberView, sharedView } from "/static/shared_view.js";
import { durationText } from "/static/texts.js";

// Interval between pictures while the past is played [ms].
const PLAY_MS = 100;
const MARKS = {
  collision: "\u2715", stop: "\u25a0", mission: "\u25c6", program: "\u25b8", server: "\u25b2", channel: "\u25b2",
};
const LEGEND = Object.entries({
  collision: "collision", stop: "stop", mission: "mission begins or ends", program: "program starts or ends",
  server: "server or channel",
});

export default {
  // floor: that of films, "" for none; floors: those that are shown.
  props: { floor: String, floors: Array, happenings: Array },
  // show: {isLive: true}, or of the past {isLive: false, at, recording} with `floors`, the names of a recording's
  // floors, or `seen`, floors by name as they were. look: an event whose mark was pressed.
  emits: ["show", "look"],
  template: `
    <div class="time-bar" role="group" aria-label="Look back">
      <div class="time-row">
        <q-btn dense no-caps class="time-live" :color="isLive ? 'primary' : undefined" :outline="!isLive" label="Live"
               :aria-pressed="isLive" title="Show what happens now" @click="goLive" />
        <q-btn dense flat round icon="replay_10" aria-label="10 s back" title="10 s back" @click="seek(at - 10)" />
        <q-btn dense flat round :icon="isRunning ? 'pause' : 'play_arrow'" :aria-label="isRunning ? 'Pause' : 'Play'"
               :title="isRunning ? 'Hold this picture; the world goes on' : 'Play'" @click="toggle" />
        <q-btn dense flat round icon="forward_10" aria-label="10 s ahead" title="10 s ahead" :disable="isLive"
               @click="seek(at + 10)" />
        <select v-model.number="speed" aria-label="Speed" title="Speed">
          <option :value="1">replay 1x</option><option :value="4">4x</option><option :value="20">20x</option>
        </select>
        <span class="time-begin" title="One can look back to here">{{ to > 1 ? clock(from) : "" }}</span>
        <div class="time-line">
          <div class="time-marks" aria-hidden="true">
            <span v-for="mark in marks" :key="mark.at + ' ' + mark.number" :class="'is-' + mark.kind"
                  :style="{ left: mark.left + '%' }" :title="mark.title" @click="$emit('look', mark)">
              {{ mark.sign }}</span>
          </div>
          <div v-if="marks.length" class="time-legend" aria-hidden="true">
            <span v-for="[kind, words] in legend" :key="kind" :class="'is-' + kind">
              <b>{{ signs[kind] }}</b> {{ words }}</span>
          </div>
          <div class="time-gaps" aria-hidden="true"><i v-for="gap in gaps" :key="gap.begin" :style="gap" /></div>
          <input type="range" :min="from" :max="to" step="1" :value="at" aria-label="Time" :aria-valuetext="text"
                 @input="seek(Number($event.target.value))">
        </div>
        <span class="time-text">{{ text }}</span>
        <select v-if="recordings.length" v-model="recording" aria-label="What to look at" class="time-source">
          <option value="">running system</option>
          <option v-for="each in recordings" :key="each.key" :value="each.key">{{ each.name }}</option>
        </select>
        <q-btn dense flat round icon="folder_open" aria-label="Open a recording" title="Open a recording"
               :loading="isOpening"
               @click="$refs.file.click()" />
        <input ref="file" type="file" accept=".mcap" hidden @change="open">
        <q-btn v-if="floor" dense flat round icon="movie" aria-label="Film" title="Make a film"
               :aria-expanded="isFilming" @click="isFilming = !isFilming; error = ''" />
      </div>
      <div v-if="isFilming && floor" class="time-row">
        <span>Film of {{ floor }} from</span>
        <q-btn dense outline no-caps :label="clock(begin)" title="Begin at the shown time" @click="begin = at" />
        <span>to</span>
        <q-btn dense outline no-caps :label="clock(end)" title="End at the shown time" @click="end = at" />
        <label>speed <select v-model.number="filmSpeed">
          <option :value="1">1x</option><option :value="4">4x</option><option :value="20">20x</option></select></label>
        <q-btn v-if="film?.phase !== 'making'" dense no-caps color="primary" label="Make film" :disable="begin >= end"
               @click="makeFilm" />
        <q-btn v-else dense no-caps outline :label="'Cancel, ' + film.seconds.toFixed(0) + ' s'" @click="cancelFilm" />
        <a v-if="film?.phase === 'ready'" :href="'/film/' + film.number" download>Download the film</a>
        <span v-if="film?.phase === 'making'" class="time-note" role="status">the film is being made</span>
        <span v-else-if="begin >= end" class="time-note">go to a time and press the button beside "to"</span>
      </div>
      <div v-if="away" class="time-row" role="status">Nobody saw this: no console was there {{ away }}.</div>
      <div v-if="error || lost" class="time-row is-problem" role="alert">{{ error || lost }}</div>
    </div>`,
  data() {
    return {
      signs: MARKS, legend: LEGEND,
      isLive: true, isPlaying: false, at: 0, from: 0, to: 1, now: 0, times: [], speed: 1, recording: "", recordings: [],
        isOpening: false,
      error: "", lost: "", isFilming: false, begin: 0, end: 0, filmSpeed: 1, film: null,
    };
  },
  computed: {
    isRunning() {
      return this.isLive || this.isPlaying;
    },
    text() {
      if (this.isLive) return this.to > 1 ? `${this.clock(this.to)} now` : "";
      return this.recording ? `${this.clock(this.at)}, ${durationText(this.at - this.from)}`
        : `${this.clock(this.at)}, ${durationText(this.now - this.at)} ago`;
    },
    // Times without a console, as parts of the line, and the one that is shown, in words.
    gaps() {
      const share = (at) => `${(100 * Math.max(at, 0)) / (this.to - this.from)}%`;
      const shown = this.recording ? [] : this.times.filter(([, end]) => end > this.from);
      return shown.map(([begin, end]) => ({ begin, end, left: share(begin - this.from), width: share(end - begin) }));
    },
    away() {
      const gap = this.isLive ? null : this.gaps.find(({ begin, end }) => this.at >= begin && this.at < end);
      return gap ? `from ${this.clock(gap.begin)} to ${this.clock(gap.end)}` : "";
    },
    marks() {
      if (this.recording || this.to <= this.from) return [];
      return this.happenings.filter((each) => MARKS[each.kind] && each.at >= this.from).slice(-300).map((each) => ({
        ...each, sign: MARKS[each.kind], left: (100 * (each.at - this.from)) / (this.to - this.from),
        title: `${this.clock(each.at)} ${each.text}`,
      }));
    },
  },
  watch: {
    floors(names, before) {
      if (!this.isLive && names.join("\n") !== before.join("\n")) this.load();
    },
    isFilming() {
      if (this.isFilming && !this.end) [this.begin, this.end] = [Math.max(this.from, this.at - 30), this.at];
    },
    recording() {
      this.error = "";
      const chosen = this.recordings.find((each) => each.key === this.recording);
      if (!chosen) {
        this.begin = this.end = 0;
        return this.goLive();
      }
      [this.from, this.to] = [this.begin, this.end] = chosen.past;
      this.isPlaying = false;
      const at = this.kept ?? this.from;
      this.kept = undefined;
      this.$emit("show", { isLive: false, floors: chosen.floors, recording: chosen.key, at });
      this.seek(at);
    },
  },
  mounted() {
    this.unlisten = live.listen((kind) => kind === "state" && this.news());
    this.timer = setInterval(() => this.play(), PLAY_MS);
    this.asked = call("recordings").then((rows) => { this.recordings = rows; }).catch(() => {});
  },
  unmounted() {
    this.unlisten();
    clearInterval(this.timer);
    clearInterval(this.filmTimer);
  },
  methods: {
    clock(at) {
      return at ? clockText(at) : "-";
    },
    // Go on with the moment that was looked at on another page; `kept` until it can be shown.
    async restore() {
      const { past } = sharedView;
      if (!past) return;
      if (past.recording) await this.asked;
      this.kept = past.at;
      if (!past.recording) this.news();
      else if (this.recordings.some((each) => each.key === past.recording)) this.recording = past.recording;
      else this.goLive();
    },
    remember() {
      rememberView({ past: this.isLive ? null : { at: this.at, recording: this.recording } });
    },
    news() {
      const past = live.state?.past;
      if (!past) return;
      this.now = past[1];
      this.times = live.state.gaps;
      if (this.recording) return;
      [this.from, this.to] = past;
      if (this.isLive) this.at = this.to;
      if (this.kept >= this.from) this.seek(this.kept);
      else if (this.kept !== undefined) this.goLive();
    },
    goLive() {
      this.kept = undefined;
      this.isLive = true;
      this.isPlaying = false;
      this.recording = "";
      this.error = this.lost = "";
      this.news();
      this.remember();
      this.$emit("show", { isLive: true });
    },
    toggle() {
      if (this.isLive) this.seek(this.to);
      else if (this.isPlaying) this.isPlaying = false;
      else {
        if (this.at >= this.to) this.at = this.from;
        this.playedAt = performance.now();
        this.isPlaying = true;
      }
    },
    seek(at) {
      this.isLive = false;
      this.kept = undefined;
      this.at = Math.min(Math.max(at, this.from), this.to);
      this.load();
    },
    play() {
      if (!this.isPlaying) return;
      const now = performance.now();
      const at = this.at + ((now - this.playedAt) / 1000) * this.speed;
      this.playedAt = now;
      this.at = Math.min(at, this.to);
      if (at >= this.to && !this.recording) return this.goLive();
      if (at >= this.to) this.isPlaying = false;
      this.load();
    },
    // Show the floors at the chosen time; one moment at a time, the newest wins.
    async load() {
      this.remember();
      if (this.isLoading || !this.floors.some(Boolean)) return;
      this.isLoading = true;
      const wanted = () => JSON.stringify([this.floors, this.at, this.recording]);
      try {
        let loaded;
        do {
          loaded = wanted();
          const { at, recording } = this;
          const { floors, problem } = await pastFloors(this.floors, at, recording);
          if (this.isLive) return;
          this.lost = problem;
          if (problem) this.isPlaying = false;
          if (floors.size) this.$emit("show", { isLive: false, seen: floors, at, recording });
        } while (loaded !== wanted());
      } finally {
        this.isLoading = false;
      }
    },
    async open(event) {
      const [file] = event.target.files;
      event.target.value = "";
      if (!file) return;
      await attempt(this, async () => {
        const answer = await fetch(`/recording?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file })
          .catch((error) => { throw new Error(failure(error)); });
        const content = await answer.json();
        if (content.error) throw new Error(content.error);
        this.recordings = await call("recordings");
        this.recording = content.answer.key;
      }, { busy: "isOpening", problem: "error" });
    },
    async makeFilm() {
      this.error = "";
      const wanted = { floor: this.floor, begin: this.begin, end: this.end, speed: this.filmSpeed,
        recording: this.recording };
      try {
        this.film = { number: await call("start_film", wanted), phase: "making", seconds: 0 };
        clearInterval(this.filmTimer);
        this.filmTimer = setInterval(() => this.watchFilm(), 500);
      } catch (error) {
        this.error = error.message;
      }
    },
    async watchFilm() {
      const { number } = this.film;
      try {
        const state = await call("film_state", { film: number });
        if (this.film?.number !== number) return;
        this.film = { number, ...state };
        if (state.problem && state.problem !== "cancelled") this.error = `no film: ${state.problem}`;
      } catch (error) {
        if (this.film?.number !== number) return;
        this.error = error.message;
        this.film = null;
      }
      if (this.film?.phase !== "making") clearInterval(this.filmTimer);
    },
    async cancelFilm() {
      await call("cancel_film", { film: this.film.number }).catch((error) => { this.error = error.message; });
    },
  },
};
