// The robot of the program page: its state, what is taken from it for icons, and the run of the program on it.
import { plainWords } from "/static/icon_looks.js";
import { call, live } from "/static/live.js";
import { LOST_S } from "/static/robot_rows.js";
import { movables } from "/static/movable_objects.js";
import { fourDigits } from "/static/program_model.js";
import { shiftedPaths } from "/static/program_run.js";
import { rememberView, sharedView } from "/static/shared_view.js";
import { shortened } from "/static/texts.js";
import { VIRTUAL } from "/static/switch_panel.js";

const STORED_ROBOT = "robocorba-robot";
const STORED_RUN = "robocorba-run";
const LEFT_ARM = 0, RIGHT_ARM = 7, ARM = 7, LUMBAR = 14;

function state() {
  return {
    rows: {}, robots: [], robot: "", robotRow: { name: "" }, panel: "", names: {}, floors: [],
    marks: { runningId: null, holderIds: new Set(), doneIds: new Set(), failedId: null, report: null, condition: "" },
    progress: { text: "", kind: "", isOver: false },
  };
}

const methods = {
  news() {
    const wait = live.state ? (performance.now() - live.stateAt) / 1000 : 0;
    this.rows = live.state?.robots ?? {};
    const bound = Object.entries(this.rows).filter(([, row]) => row.bound);
    this.robots = bound.map(([name, row]) => ({ name, text: `${name} - ${stateText(row, wait)}` }));
    const names = bound.map(([name]) => name);
    const before = this.robot;
    if (!names.includes(this.robot)) {
      const kept = [this.stored(STORED_ROBOT), sharedView.robot].find((name) => names.includes(name));
      this.robot = kept ?? (this.robot || names[0] || "");
    }
    this.robotRow = robotRow(this.robot, this.rows[this.robot], wait);
    this.floors = live.names;
    this.findNames(names);
    if (!this.schema) return;
    if (before !== this.robot) this.robotChosen();
    else this.checkWhereRobotIs();
  },
  findNames(robots) {
    const before = this.names.objects?.join("\n"), objects = movables(live.names).map(({ name }) => name).sort();
    this.names = { objects, robots };
    if (this.schema && objects.join("\n") !== before) this.findIncomplete();
  },
  choose(robot) {
    this.robot = robot;
    this.store(STORED_ROBOT, robot);
    rememberView({ robot });
    this.news();
    this.robotChosen();
  },
  robotChosen() {
    this.panel = "";
    this.findings = [];
    this.run.close();
    this.run.clear();
    this.progressed();
    this.checkSoon();
    this.followAgain();
  },
  // ---- taken from the robot or the map ----
  targetOf(node) {
    return node.icon === "move_table" ? node.values.to ?? {} : node.values;
  },
  pick(values, isNew = true) {
    const { node } = this;
    if (isNew) this.model.separate();
    this.setAll(node.id, node.icon === "move_table" ? { to: { ...node.values.to, ...values } } : values, "target");
  },
  takePose() {
    const at = this.rows[this.robot]?.state?.at;
    if (!at) return this.note(`${this.robot} does not report its pose`, "error");
    const pose = { x: fourDigits(at.x), y: fourDigits(at.y), heading: fourDigits(at.heading) };
    this.pick(this.node.icon === "mbase_to" ? pose : { floor: at.floor, ...pose });
  },
  async takePosture() {
    const joints = live.joints(this.robot), { node } = this;
    if (!joints) return this.note(`${this.robot} does not report its joints`, "error");
    const isRight = node.values.hand === "right", first = isRight ? RIGHT_ARM : LEFT_ARM;
    let values;
    if (node.icon === "lumbar") values = { lower: fourDigits(joints[LUMBAR]), upper: fourDigits(joints[LUMBAR + 1]) };
    else if (node.icon === "mhand_joints") {
      values = { joints: [...joints].slice(first, first + ARM).map((angle) => fourDigits(angle)) };
    } else values = await this.handPose(joints, isRight ? "right" : "left");
    if (!values) return;
    if (node.icon !== "lumbar" && !node.values.hand) values.hand = "left";
    this.setAll(node.id, values);
  },
  async handPose(joints, side) {
    const poses = await call("hand_poses", { joints: [...joints] }).catch(({ message }) => this.note(message, "error"));
    return poses ? Object.fromEntries(Object.entries(poses[side]).map(([name, value]) => [name, fourDigits(value)])) : null;
  },
  setAll(id, values, kind = "taken") {
    for (const [name, value] of Object.entries(values)) this.model.set(id, name, value, `${id} ${kind}`);
    this.changed();
  },
  // ---- run ----
  async start(isStepping, first = 0) {
    const ids = this.idsByPath(), { robot } = this, program = this.jsonText;
    if (await this.order("run_program", { program, step: isStepping, first })) {
      this.store(STORED_RUN, JSON.stringify({ robot, program, first }));
      this.run.follow(robot, ids, first);
      this.progressed();
    } else {
      this.checkSoon();
    }
  },
  idsByPath() {
    return new Map([...this.model.walk()].map(({ path, node }) => [path, node.id]));
  },
  async step() {
    if (this.robotRow.condition === "paused") await this.order("step_program");
    else await this.start(true);
  },
  async pause() {
    await this.order(this.robotRow.condition === "paused" ? "resume_program" : "pause_program");
  },
  // After a reload: follow the program that was started from here, or show how it ended.
  followAgain() {
    let last = null, name = "";
    try {
      last = JSON.parse(this.stored(STORED_RUN));
      name = JSON.parse(last.program).name;
    } catch { /* of an older version, or none */ }
    if (!name || last.robot !== this.robot) return;
    const isSame = last.program === this.jsonText;
    const ids = isSame ? this.idsByPath() : new Map();
    if (isSame || !isActive(this.robotRow)) this.run.follow(this.robot, ids, last.first, name);
  },
  progressed() {
    const { runningId, holderIds, doneIds, failedId, report, condition, problem, isFollowed } = this.run;
    if (runningId !== null && runningId !== this.marks.runningId) this.reveal(runningId);
    this.marks = { runningId, holderIds: new Set(holderIds), doneIds: new Set(doneIds), failedId, report, condition };
    this.progress = problem ? { text: plainWords(problem), kind: "error", isOver: true }
      : progressOf(report && { ...report, icon: this.run.pagePath(report.icon) }, isFollowed);
    if (report && report.result !== "no_result") this.checkSoon();
  },
  dismiss() {
    this.run.clear();
    this.store(STORED_RUN, "");
    this.progressed();
  },
  async takeProgram() {
    const { robot } = this;
    const text = await call("loaded_program", { robot }).catch(({ message }) => this.note(message, "error"));
    const isOpen = text !== undefined && this.openText(`the program of ${robot}`, text);
    if (isOpen && isActive(this.robotRow)) this.run.follow(robot, this.idsByPath());
  },
  async switched({ robot, adaptor, isRun }) {
    this.panel = "";
    this.note(`${robot} now moves the robot behind ${adaptor}`);
    if (isRun) await this.start(false);
  },
  async order(operation, argument = {}) {
    const problem = await call(operation, { robot: this.robot, ...argument }).then(() => "", ({ message }) => message);
    if (problem) this.note(shiftedPaths(problem, argument.first ?? 0), "error");
    else if (this.message.kind === "error") this.note("");
    return !problem;
  },
};

function isActive(robotRow) {
  return ["running", "paused"].includes(robotRow.condition);
}

function stateText(row, wait) {
  if (!row.state) return row.problem ? "does not answer" : "connecting";
  if (row.age + wait > LOST_S) return "does not answer";
  return `${shortened(row.state.display.text, 40)}, ${row.state.at.floor}`;
}

function robotRow(name, row, wait) {
  if (!name) return { name: "" };
  if (!row?.state) return { name, problem: row?.problem ? `${name} does not answer: ${row.problem}` : "" };
  const { condition, adaptor, display } = row.state, age = row.age + wait;
  const problem = age > LOST_S ? `${name} does not answer since ${Math.round(age)} s` : "";
  const isActual = adaptor !== VIRTUAL, runs = row.state.program.name;
  const { floor } = row.state.at;
  return { name, condition: condition.toLowerCase(), adaptor, isActual, runs, shown: display.text, problem, floor };
}

function progressOf(report, isFollowed) {
  if (!report) return { text: "", kind: "", isOver: false };
  const time = `${report.seconds.toFixed(1)} s`;
  const count = report.icons_done === 1 ? "1 icon" : `${report.icons_done} icons`;
  if (isFollowed) return { text: `${report.name}: ${count} done, ${time}`, kind: "", isOver: false };
  const kind = report.result === "done" ? "done" : "error", reason = report.reason ? `: ${plainWords(report.reason)}` : "";
  const where = report.result !== "done" && report.icon ? ` at ${plainWords(report.icon)}` : "";
  return { text: `${report.name}: ${report.result}${where} after ${time}${reason}`, kind, isOver: true };
}

export const robotSide = { state, methods };
