// Panels beside the map: findings, paths, and the edits of all editors.
import { shown } from "/static/map_form.js";
import { PATH_STYLES } from "/static/map_layer.js";

export const FindingsPanel = {
  directives: { shown },
  props: { result: Object, refused: Object, chosen: Number, isBusy: Boolean, radius: Number, version: Number },
  emits: ["check", "show", "radius", "dismiss"],
  template: `
    <div>
      <div v-if="refused" class="map-refused" role="alert">
        <b>Not accepted</b> <q-btn flat dense round size="sm" icon="close" aria-label="Dismiss"
            @click="$emit('dismiss')" />
        <p>{{ refused.reason }}</p>
        <ul v-if="refused.problems.length > 1"><li
            v-for="problem in refused.problems"><b>{{ problem.kind }} {{ problem.name }}</b> {{ problem.floor }}: {{
              problem.reason }}</li></ul>
      </div>
      <div class="console-actions map-line">
        <label>robot radius <input v-shown="radius" type="number" min="0.05" max="5" step="0.05" class="map-number"
          @change="$emit('radius', $event.target.valueAsNumber || 0.4)"> m</label>
        <q-btn dense no-caps color="primary" label="Check this floor" :loading="isBusy"
            @click="$emit('check', false)" />
        <q-btn dense no-caps outline label="Check all floors" :disable="isBusy" @click="$emit('check', true)" />
      </div>
      <p v-if="!result"
          class="map-none">What robots can't do on this map: blocked roads, parts that they can't reach.</p>
      <p v-else-if="!result.count" class="map-none">Nothing found: a robot reaches every node.</p>
      <p v-if="result && result.version !== version" class="map-none">The map has changed since; check again.</p>
      <ol v-if="result" class="map-list">
        <li v-for="(finding, n) in result.findings" :key="n">
          <button :aria-pressed="n === chosen" @click="$emit('show', n)">
            <b>{{ finding.kind }} {{ finding.name }}</b> <small>{{ finding.floor }}</small><br>{{ finding.reason
              }}</button></li>
      </ol>
      <p v-if="result && result.count > result.findings.length"
          class="map-none">{{ result.count - result.findings.length }} more</p>
    </div>`,
};

export const PathsPanel = {
  props: { paths: Array, ends: Array, chosen: String, isBusy: Boolean, isOn: Boolean },
  data: () => ({ styles: PATH_STYLES }),
  emits: ["choose", "start", "clear"],
  template: `
    <div>
      <div class="console-actions">
        <q-btn dense no-caps color="primary" icon="route" label="Plan a path" :loading="isBusy"
            @click="$emit('start')" />
        <q-btn v-if="ends.length" dense no-caps outline label="Clear" @click="$emit('clear')" /></div>
      <p v-if="!paths.length && !isBusy" class="map-none">
        {{ !isOn ? 'Start and goal by two clicks, also on different floors.' : ends.length === 1 ? 'Click the goal.' :
          'Click the start on the map.' }}</p>
      <ul class="map-list" role="radiogroup" aria-label="Paths">
        <li v-for="path in paths" :key="path.mode">
          <button role="radio" :aria-checked="path.mode === chosen" :aria-pressed="path.mode === chosen"
              @click="$emit('choose', path.mode)">
            <svg width="34" height="8" aria-hidden="true"><line x1="0" y1="4" x2="34" y2="4" stroke="currentColor"
                stroke-width="3"
              :stroke-dasharray="styles[path.mode].dash.join(' ')" /></svg>
            <b>{{ path.mode }}</b>
            <span v-if="path.points">{{ path.length.toFixed(2) }} m, {{
              path.points.length }} points</span>
            <span v-else class="map-reason">no path: {{ path.reason }}</span></button></li>
      </ul>
    </div>`,
};

export const EditsPanel = {
  props: { news: Array },
  template: `
    <div>
      <p v-if="!news.length" class="map-none">Nobody has edited the map since this page was opened.</p>
      <ul class="map-list"><li v-for="edit in news" :key="edit.version"
          :title="'version ' + edit.version">{{ edit.text }}</li></ul>
    </div>`,
};
