// Methods of the 3D page: the past instead of the present. Places are recorded, postures, rays and paths are not.
import { live } from "/static/live.js";
import { clockText, lookBack, recordedPlan } from "/static/past.js";
import { degrees } from "/static/robot_rows.js";

export const pastMethods = {
  // The plan of a floor, or undefined until it is loaded.
  plan(name) {
    const { recording } = this.past;
    return recording ? recordedPlan(recording, name, () => this.isGone || this.loadPlans()) : live.plan(name);
  },
  // News of the time bar.
  showTime({ isLive, at, recording, floors, seen }) {
    const isOther = isLive !== this.past.isLive || recording !== this.past.recording;
    this.past = { isLive, at, recording, floors: recording ? floors ?? this.past.floors : undefined };
    this.seen = seen ?? new Map();
    if (isOther) this.changeTime();
    this.update();
    this.updateFacts();
  },
  // From the present to the past or back, or to a recording.
  changeTime() {
    this.isPosing = false;
    this.floors = this.past.floors ?? live.names;
    this.showFirst();
    for (const mesh of this.meshes.values()) mesh.setObjects([]); // numbers of bodies may mean others
    this.want();
    this.loadPlans();
    this.updateRays();
  },
  lookBack(happening) {
    lookBack(this, happening);
  },
  factsThen(robot) {
    const { at } = this.past;
    const rows = [["time", at ? clockText(at) : ""]];
    if (!robot) return [...rows, ["", "not on the shown floor then"]];
    rows.push(["at", `${robot.floor} ${robot.x.toFixed(2)}, ${robot.y.toFixed(2)} m, ${degrees(robot.heading)}`]);
    return [...rows, ["speed", `${robot.speed.toFixed(2)} m/s`], ["posture", "not recorded"]];
  },
};
