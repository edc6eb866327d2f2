// The check of the program while it is edited: methods of the program page's component. The robot's agent checks all
// icons up to the first incomplete one, from where the robot is.
import { call } from "/static/live.js";
import { plainWords } from "/static/icon_looks.js";
import { missing } from "/static/icon_problems.js";
import { live } from "/static/live.js";
import { plainOf } from "/static/program_model.js";

// Time from the last change to the check [ms].
const CHECK_MS = 400;
// Bodies that moved farther than this since the last check are a reason for another one [m], after this time [ms].
const MOVED_M = 0.05, MOVED_MS = 5000;

// The state that the methods keep in the component.
export const checkingState = () => ({ findings: [], python: "", isChecked: false, checkProblem: "" });

export const checking = {
  // What every icon lacks, by its identity; asked for after each change.
  findIncomplete() {
    this.incomplete = new Map();
    for (const { node } of this.model.walk()) {
      const found = missing(this.schema, node), { object } = node.values, { objects = [] } = this.names;
      const isLost = node.icon === "gripper" && object && objects.length && !objects.includes(object);
      if (isLost) found.push({ kind: "invalid", parameter: "object", reason: "is not on the map" });
      if (found.length) this.incomplete.set(node.id, found);
    }
  },
  // Problems of an icon: {kind: incomplete, invalid, error or note, parameter, reason}.
  problemsOf(id) {
    return [...(this.incomplete.get(id) ?? []), ...this.findings.filter((finding) => finding.nodeId === id)];
  },
  checkSoon() {
    this.isChecked = false;
    clearTimeout(this.checkTimer);
    this.checkTimer = setTimeout(() => this.check(), CHECK_MS);
  },
  // The icons of the program before the first one that is incomplete or holds one that is.
  completeIcons() {
    const isWhole = (node) => !this.incomplete.has(node.id) && Object.values(node.bodies).flat().every(isWhole);
    const end = this.model.icons.findIndex((node) => !isWhole(node));
    return end < 0 ? this.model.icons : this.model.icons.slice(0, end);
  },
  async check() {
    if (!this.schema) return;
    const revision = this.revision, robot = this.robot, icons = this.completeIcons();
    this.checkedAt = this.placeOf(robot);
    this.checkedBodies = this.bodiesAround(robot);
    this.checkedTime = performance.now();
    if (!icons.length) {
      this.findings = [];
      this.python = "";
      this.checkProblem = "";
      this.isChecked = true;
      return;
    }
    try {
      const program = JSON.stringify(this.model.plain(icons));
      const missions = robot ? this.firstMissions(icons) : [];
      const [{ findings, python }, ...parties] = await Promise.all([call("check_program", { robot, program }),
        ...missions.map(({ node }) => call("mission_party", { leader: robot, icon: plainOf(node), with_busy: true }))]);
      if (revision !== this.revision || robot !== this.robot) return;
      const impossible = missions.map(({ path }, n) => ({ kind: "error", icon: path, parameter: "", ...parties[n] }));
      const others = findings.filter(({ kind, icon }) => kind !== "note" || !missions.some(({ path }) => path === icon));
      this.findings = [...others, ...impossible.filter(({ reason }) => reason)].map((finding) => ({
        ...finding, reason: plainWords(finding.reason), nodeId: this.model.at(finding.icon)?.id ?? null,
      }));
      this.python = this.incomplete.size ? "" : python;
      this.checkProblem = "";
    } catch (error) {
      if (revision !== this.revision || robot !== this.robot) return;
      this.findings = [];
      this.python = "";
      this.checkProblem = `not checked: ${plainWords(error.message)}`;
    }
    this.isChecked = true;
  },
  // The cooperative icons, which robots leave unchecked, of each object the first one: later ones begin elsewhere.
  firstMissions(icons) {
    const found = new Map();
    for (const { node, path } of this.model.walk(icons)) {
      const { table, object, taker } = node.values, about = table ?? (taker && object);
      if (about && !found.has(about)) found.set(about, { node, path });
    }
    return [...found.values()];
  },
  // Check again when the robot rests somewhere else than at the last check.
  checkWhereRobotIs() {
    if (this.robotRow.condition !== "idle" || !this.isChecked) return;
    const at = this.placeOf(this.robot);
    if (at !== this.checkedAt || (this.checkProblem && !this.robotRow.problem)) this.checkSoon();
    else if (this.haveBodiesMoved()) this.check();
  },
  // Places of the bodies around a robot on its floor by number; null until the floor's first news.
  bodiesAround(robot) {
    const name = this.rows[robot]?.state?.at.floor;
    if (!name) return null;
    if (this.watchedFloor !== name) live.want(this, { floors: [name] });
    this.watchedFloor = name;
    const floor = live.floor(name);
    if (!floor.receivedAt) return null;
    const others = [...floor.bodies.values()].filter((body) => body.name !== robot);
    return new Map(others.map(({ number, x, y }) => [number, { x, y }]));
  },
  haveBodiesMoved() {
    const now = this.bodiesAround(this.robot);
    this.checkedBodies ??= now;
    if (!now || document.hidden || performance.now() - this.checkedTime < MOVED_MS) return false;
    const before = this.checkedBodies;
    const moved = ([key, { x, y }]) => !(Math.hypot(x - before.get(key)?.x, y - before.get(key)?.y) <= MOVED_M);
    return now.size !== before.size || [...now].some(moved);
  },
  // Where a robot stands and how its arms are, in steps that matter for a check.
  placeOf(robot) {
    const state = this.rows[robot]?.state;
    if (!state) return "";
    const { at, actor } = state;
    const joints = actor.joints.map((joint) => Math.round(joint * 50));
    return [at.floor, Math.round(at.x * 20), Math.round(at.y * 20), Math.round(at.heading * 20), ...joints].join(" ");
  },
};
