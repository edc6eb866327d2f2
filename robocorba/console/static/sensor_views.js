// What sensors see beside the picture: the legend of rays, and the eight distances around a robot's base.
import { colorsNow } from "/static/floor_colors.js";
import { placed } from "/static/segments.js";

// Robots whose areas are drawn where none is selected.
const MOST_AREAS = 4;
const KINDS = { laser: "laser", proximity: "proximity" };
// Directions of the cells of the ring, row by row, in eighths of a turn from ahead to the left; the robot is between.
const CELLS = [1, 0, 7, 2, null, 6, 3, 4, 5];
const NAMES = ["front", "front left", "left", "back left", "back", "back right", "right", "front right"];

// What the colours of some scans mean. scans: as live.scansOn() has them.
export const RayLegend = {
  props: { scans: Array },
  template: `
    <ul v-if="rows.length" class="ray-legend" aria-label="Rays of sensors">
      <li v-for="row in rows" :key="row.text"><i :class="row.kind" :style="row.style"></i>{{ row.text }}</li>
    </ul>`,
  computed: {
    rows() {
      const colors = colorsNow();
      const { scans } = this, rows = [];
      for (const [sensor, text] of Object.entries(KINDS)) {
        if (scans.some((scan) => scan.sensor === sensor)) {
          rows.push({ text, kind: "is-fan", style: { color: colors[sensor] } });
        }
      }
      if (scans.some((scan) => !scan.virtual)) {
        rows.push({ text: "sensor of an actual robot", kind: "is-own", style: { color: colors.text } });
      }
      if (scans.some((scan) => scan.virtual)) {
        rows.push({ text: "virtual sensor", kind: "is-fan", style: { color: colors.text } });
      }
      if (scans.some((scan) => scan.hits.includes(2))) {
        rows.push({ text: "in no map", kind: "is-unmapped", style: { color: colors.unmapped } });
      }
      return rows;
    },
  },
};

// The eight distances of a ring of proximity sensors, as they lie around the robot, whose front is above.
export const ProximityRing = {
  props: { scan: Object },
  template: `
    <div class="proximity-ring" role="group" aria-label="Proximity [m]">
      <span v-for="(cell, index) in cells" :key="index" :class="cell?.kind" :title="cell?.title">{{ cell?.text }}</span>
    </div>`,
  computed: {
    cells() {
      const { ranges, hits, rim } = this.scan;
      return CELLS.map((k) => {
        if (k === null) return { text: "\u25b2", kind: "is-robot", title: "the robot" };
        if (!hits[k]) return { text: "free", kind: "is-free", title: `${NAMES[k]}: nothing within reach` };
        const text = (ranges[k] - rim).toFixed(2), isUnmapped = hits[k] === 2;
        const title = `${NAMES[k]}: ${text} m${isUnmapped ? ", in no map" : ""}`;
        return { text, kind: isUnmapped ? "is-unmapped" : "", title };
      });
    },
  },
};

// Whether a scan is that of a ring of eight, the first of them ahead.
export function isRing({ sensor, angles, mount }) {
  return sensor === "proximity" && angles.count === NAMES.length && !mount.heading;
}

// Whether the area that a scan sees is drawn, beside what its rays hit: the areas of many robots would hide the map.
export function hasAreas(scans, selected) {
  const isFew = new Set(scans.map((scan) => scan.robot)).size <= MOST_AREAS;
  return (scan) => (selected ? scan.robot === selected : isFew);
}

// The lengths of rays that bound the area of a scan: without single rays that got no echo between others.
export function areaRanges({ ranges, hits }) {
  return ranges.map((range, k) => (!hits[k] && hits[k - 1] && hits[k + 1] ? Math.min(ranges[k - 1], ranges[k + 1])
    : range));
}

// Where the rays of a scan end: a function of the number of a ray, also between two, and a length [m], that gives [x, y].
export function rayEnds({ pose, mount, angles }) {
  const [[x, y]] = placed([[mount.ahead, mount.left]], { at: [pose.x, pose.y], heading: pose.heading });
  return (k, range) => {
    const bearing = pose.heading + mount.heading + angles.first + k * angles.step;
    return [x + range * Math.cos(bearing), y + range * Math.sin(bearing)];
  };
}

// In words, what a sensor sees.
export function sensorFact({ sensor, ranges, hits, rim, range, virtual }) {
  const seen = ranges.filter((_, k) => hits[k]).map((each) => each - rim);
  const unmapped = hits.filter((hit) => hit === 2).length;
  const words = [seen.length ? `nearest ${Math.min(...seen).toFixed(2)} m` : `nothing within ${range.toFixed(1)} m`];
  if (seen.length) words.push(`${seen.length} of ${ranges.length} rays hit`);
  if (unmapped) words.push(`${unmapped} in no map`);
  return [sensor, `${virtual ? "virtual" : "actual"}: ${words.join(", ")}`];
}
