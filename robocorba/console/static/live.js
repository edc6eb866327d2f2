// The connection of a page to the console's server: live floors as binary frames, everything else as JSON.
//
// `live` is shared by all components of a page. It reconnects by itself; listeners are called with the kind of news:
// "connection", "floor", "plan", "state", "past", "scans", "postures" (both with the floor), "reservations",
// "missions".
//
// A page says what it wants: {"watch": [floors], "scans": [floors], "robots": [names], "postures": [floors],
// "reservations": true}; all but `watch` may be missing. Scans of `robots` go before others. Beside frames it gets, as
// JSON:
//   {"scans": {"floor": "L1", "whole": true, "scans": [scan, ...], "gone": [key, ...]}}
//     a scan: {"key": "R1/laser", "robot": "R1", "sensor": "laser", "time": 12.3, "pose": {"x", "y", "heading"},
//     "mount": {"ahead", "left", "heading"}, "angles": {"first", "step", "count"}, "range": 8, "rim": 0,
//     "ranges": [...], "hits": [0, 1, 2, ...], "virtual": true}. `pose` is the robot's, `mount` that of the sensor in
//     the robot's frame; ray k points to the mount's heading + first + k * step; `ranges` are its lengths from the
//     sensor's middle, where hits[k] is 0 to the end of its reach, 2 to what no map has; rays begin at `rim`. `sensor`
//     is "laser", "proximity", or "sensor 1" and so on for others. `virtual` is false for an actual robot's own sensor.
//   {"postures": {"floor": "L1", "whole": true, "robots": {"R1": [joints]}, "gone": ["R2"]}}
//   {"reservations": [{"robot": "R1", "phase": "granted" or "waiting", "ahead": 0, "left": 12.0,
//     "areas": [{"floor": "L1", "polygon": [[x, y], ...]}]}]}
//   {"missions": [row, ...], "whole": true, "gone": [name, ...], "now": 1700000000.5}, if it wants {"missions": true};
//     the rows are those of RoboCorba::MissionState, in snake case, with `result` "running", "done", "aborted" or "failed".
// `whole` means that the message holds all of the floor; without it, what has changed. Lengths in m, angles in rad,
// times in simulated s.

import { Floor, readFrame } from "/static/floor_state.js";

export { attempt, call } from "/static/calls.js";

const RECONNECT_MS = [250, 500, 1000, 2000];
// A console that serves as many pages as it can refuses further ones with this code and a reason; pause before the next
// attempt.
const TRY_AGAIN_LATER = 1013;
const REFUSED_MS = 5000;
// The server sends something at least once a second; without news for this time the connection is regarded as lost.
const SILENCE_MS = 4000;
// A plan that could not be loaded is asked for again after this time; each request ends after at most PLAN_MS.
const AGAIN_MS = 2000;
const PLAN_MS = 10000;

class Live {
  constructor() {
    this.floors = new Map();
    this.names = [];
    this.plans = new Map();
    this.mapVersion = 0;
    this.state = null;
    this.stateAt = 0;
    this.isConnected = false;
    // Why the console serves no further page; empty if it does.
    this.refusal = "";
    this.problems = {};
    // Scans by floor and key, with `receivedAt`; joint angles by robot; all reservations of areas.
    this.scans = new Map();
    this.postures = new Map();
    this.postureFloors = new Map();
    this.reservations = [];
    // Missions by name, and whether they are known; the console's clock is ahead of ours by `aheadS`.
    this.missions = new Map();
    this.missionsKnown = false;
    this.aheadS = 0;
    this.wanted = new Map();
    this.listeners = new Set();
    this.attempts = 0;
    this.lastNews = performance.now();
    this.connect();
    setInterval(() => this.checkSilence(), 1000);
  }

  // Call `listener(kind, name)` on news; returns a function that ends this.
  listen(listener) {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  // What a component wants to see: {floors: [names], scans: [names], robot: name, postures: [names], reservations: bool,
  // missions: bool}; for scans and postures, true stands for `floors`. Replaces what it wanted before; without arguments:
  // nothing any more.
  want(component, what) {
    if (what) this.wanted.set(component, what);
    else this.wanted.delete(component);
    this.sendWanted();
  }

  floor(name) {
    if (!this.floors.has(name)) this.floors.set(name, new Floor(name));
    return this.floors.get(name);
  }

  // Joint angles of a robot [rad], or undefined for one that reports none.
  joints(name) {
    const joints = this.postures.get(name) ?? this.state?.robots[name]?.state?.actor.joints;
    return joints?.length ? joints : undefined;
  }

  // The last scan of each sensor on a floor.
  scansOn(floor) {
    return [...(this.scans.get(floor)?.values() ?? [])];
  }

  // The time of the console's computer, s since 1970.
  serverNow() {
    return Date.now() / 1000 + this.aheadS;
  }

  // The plan of a floor, or undefined until it is loaded; "plan" news follow.
  plan(name) {
    const known = this.plans.get(name);
    if (name && this.mapVersion && (!known || (known.version !== this.mapVersion && !known.loading))) this.loadPlan(name);
    return known?.plan;
  }

  async loadPlan(name) {
    const version = this.mapVersion;
    const entry = this.plans.get(name) ?? {};
    entry.loading = true;
    this.plans.set(name, entry);
    try {
      const address = `/plan?floor=${encodeURIComponent(name)}&version=${version}`;
      const answer = await fetch(address, { signal: AbortSignal.timeout(PLAN_MS) });
      if (!answer.ok) throw new Error(`no plan of ${name}`);
      entry.plan = await answer.json();
      entry.version = version;
    } catch {
      // The connection is lost, or the console does not know the floor yet: who hears the news asks again.
      setTimeout(() => this.notify("plan", name), AGAIN_MS);
      return;
    } finally {
      entry.loading = false;
    }
    this.notify("plan", name);
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/live`);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    this.lastNews = performance.now();
    socket.onopen = () => {
      if (socket !== this.socket) return;
      this.attempts = 0;
      this.lastNews = performance.now();
      this.setConnected(true);
      this.sendWanted();
    };
    socket.onmessage = (message) => socket === this.socket && this.receive(message.data);
    socket.onclose = ({ code, reason }) => this.lost(socket, code === TRY_AGAIN_LATER ? reason : "");
  }

  // A socket is closed or silent. Browsers say up to a minute late that one is closed whose server hangs.
  lost(socket, refusal = "") {
    if (socket !== this.socket) return;
    this.socket = null;
    this.refusal = refusal;
    this.setConnected(false);
    const pause = RECONNECT_MS[Math.min(this.attempts++, RECONNECT_MS.length - 1)];
    setTimeout(() => this.connect(), refusal ? REFUSED_MS : pause);
  }

  checkSilence() {
    const { socket } = this;
    if (!socket || performance.now() - this.lastNews < SILENCE_MS) return;
    socket.close();
    this.lost(socket);
  }

  sendWanted() {
    if (!this.isConnected || !this.socket) return;
    const watch = new Set();
    const scans = new Set();
    const postures = new Set();
    const robots = new Set();
    let reservations = false;
    let missions = false;
    for (const what of this.wanted.values()) {
      const floors = what.floors ?? [];
      const add = (set, names) => { for (const name of names === true ? floors : names || []) set.add(name); };
      add(watch, floors);
      add(scans, what.scans);
      add(postures, what.postures);
      if (what.robot) robots.add(what.robot);
      reservations ||= Boolean(what.reservations);
      missions ||= Boolean(what.missions);
    }
    for (const floor of this.scans.keys()) if (!scans.has(floor)) this.scans.delete(floor);
    for (const [robot, floor] of this.postureFloors) {
      if (!postures.has(floor)) {
        this.postures.delete(robot);
        this.postureFloors.delete(robot);
      }
    }
    if (!reservations) this.reservations = [];
    const message = { watch: [...watch], scans: [...scans], robots: [...robots], postures: [...postures] };
    this.socket.send(JSON.stringify({ ...message, reservations, missions }));
  }

  receive(data) {
    this.lastNews = performance.now();
    if (typeof data !== "string") {
      const { header, offset } = readFrame(data);
      this.floor(header.floor).apply(header, data, offset);
      this.notify("floor", header.floor);
      return;
    }
    const news = JSON.parse(data);
    if (news.floors) {
      this.names = news.floors;
      this.mapVersion = news.map;
      this.problems = news.problems;
      this.notify("connection");
    }
    if (news.state) {
      this.state = news.state;
      this.stateAt = performance.now();
      this.notify("state");
    }
    if (news.scans) this.receiveScans(news.scans);
    if (news.postures) this.receivePostures(news.postures);
    if (news.reservations) {
      this.reservations = news.reservations;
      this.notify("reservations");
    }
    if (news.missions) this.receiveMissions(news);
  }

  receiveMissions({ missions, whole, gone, now }) {
    if (whole) this.missions.clear();
    for (const name of gone) this.missions.delete(name);
    for (const mission of missions) this.missions.set(mission.name, mission);
    this.missionsKnown = true;
    this.aheadS = now - Date.now() / 1000;
    this.notify("missions");
  }

  receiveScans({ floor, whole, scans, gone }) {
    if (whole || !this.scans.has(floor)) this.scans.set(floor, new Map());
    const known = this.scans.get(floor);
    for (const key of gone) known.delete(key);
    for (const scan of scans) known.set(scan.key, { ...scan, receivedAt: performance.now() });
    this.notify("scans", floor);
  }

  receivePostures({ floor, whole, robots, gone }) {
    const left = new Set(gone);
    for (const [robot, on] of this.postureFloors) if (whole && on === floor && !(robot in robots)) left.add(robot);
    for (const robot of left) {
      if (this.postureFloors.get(robot) !== floor) continue; // it is on another floor meanwhile
      this.postures.delete(robot);
      this.postureFloors.delete(robot);
    }
    for (const [robot, joints] of Object.entries(robots)) {
      this.postures.set(robot, joints);
      this.postureFloors.set(robot, floor);
    }
    this.notify("postures", floor);
  }

  // Whether the building is known: one without floors has none to show, and nothing is to be waited for.
  get isKnown() {
    return this.isConnected && this.mapVersion > 0 && !this.problems.floors;
  }

  // Whether all robots are known: then one that is not among them is not there.
  get knowsRobots() {
    return this.isConnected && Boolean(this.state) && !this.state.naming;
  }

  // Why no floor can be shown.
  get withoutFloors() {
    if (this.isKnown) return "the building has no floors yet: draw them on the page Map";
    return this.problems.floors || "connecting";
  }

  setConnected(isConnected) {
    this.isConnected = isConnected;
    this.notify("connection");
  }

  notify(kind, name) {
    for (const listener of [...this.listeners]) listener(kind, name);
  }
}

export const live = new Live();
