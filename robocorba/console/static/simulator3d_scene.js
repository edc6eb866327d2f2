// Methods of the 3D page: what is in the scene, from the floors that are shown, the robots' states and their links.
import { live } from "/static/live.js";
import { RobotLink } from "/static/robot_link.js";
import { displayText } from "/static/robot_display.js";
import { LOST_S, ageText } from "/static/robot_rows.js";
import { sensorFact } from "/static/sensor_views.js";

export const sceneMethods = {
  update() {
    if (!this.crowd) return;
    const robots = [];
    for (const [name, mesh] of this.meshes) {
      const floor = this.floor(name);
      if (!floor) continue;
      const bodies = [...floor.bodies.values()];
      mesh.setElevators(floor.elevators, this.drawn(1));
      if (this.isStacked) mesh.showName(this.view.spritePixel);
      const here = bodies.filter((body) => body.kind === "robot").map((body) => this.robotOf(body, mesh.plan, floor));
      robots.push(...here);
      mesh.setObjects(bodies.filter((body) => body.kind === "object"), this.hands(here));
    }
    this.crowd.hasNames = this.hasNames;
    this.crowd.set(robots, this.selected);
    this.updateGhost();
    this.follow();
    if (this.target) this.placePose();
  },
  robotOf(body, plan, floor) {
    const isLive = this.past.isLive;
    const row = isLive ? live.state?.robots[body.name] : undefined;
    const agent = row?.state;
    const waitS = (performance.now() - live.stateAt) / 1000;
    return {
      name: body.name, x: body.x, y: body.y, z: this.drawn(heightOf(body, plan, floor)), heading: body.heading,
      speed: Math.hypot(body.vx, body.vy), floor: plan.name, joints: isLive ? this.joints(body.name) : undefined,
      display: agent?.display ?? { kind: "", text: "" },
      isLost: Boolean(row) && row.age !== null && row.age + waitS > LOST_S,
    };
  },
  joints(robot) {
    return (this.isPool && this.link?.joints.get(robot)) || live.joints(robot);
  },
  // Where hands are that may hold something: those of articulated robots.
  hands(robots) {
    const found = [];
    for (const robot of robots) {
      const model = this.crowd.articulated.get(robot.name);
      if (!model) continue;
      for (const side of ["left", "right"]) {
        const at = model.group.localToWorld(model.mount(`${side}_hand`).position);
        found.push({ x: at.x, y: at.y, z: at.z - robot.z });
      }
    }
    return found;
  },
  updateRobots() {
    const names = Object.keys(live.state.robots).sort();
    if (names.join("\n") !== this.robots.join("\n")) this.robots = names;
    this.counts = {};
    for (const client of live.state.server.state?.clients ?? []) {
      this.counts[client.at.floor] = (this.counts[client.at.floor] ?? 0) + 1;
    }
    if (this.wanted.robot && names.includes(this.wanted.robot)) {
      this.selected = this.wanted.robot;
      this.source = this.wanted.pool;
      this.wanted.robot = "";
      this.isFollowing = this.wanted.isFollowing;
    }
    this.updateFacts();
  },
  updateFacts() {
    const robot = this.crowd?.robot(this.selected);
    if (!this.past.isLive) {
      this.facts = this.factsThen(robot);
      return;
    }
    const agent = live.state?.robots[this.selected]?.state;
    const rows = [];
    if (agent) {
      rows.push(["display", displayText(agent.display)], ["for", ageText(agent.display.seconds)]);
      rows.push(["at", `${agent.at.floor} ${agent.at.x.toFixed(2)}, ${agent.at.y.toFixed(2)} m`]);
    } else {
      rows.push(["", "no news of it"]);
    }
    if (robot) rows.push(["speed", `${robot.speed.toFixed(2)} m/s`]);
    if (this.isPool && this.link?.pool) rows.push(["data pool", `${(1000 * this.link.pool.lag).toFixed(0)} ms old`]);
    if (this.hasRays) rows.push(...this.scans.filter((scan) => scan.robot === this.selected).map(sensorFact));
    if (this.link?.path.length) rows.push(["path", `${this.link.path.length} points`]);
    this.facts = rows;
  },
  updateRays() {
    if (!this.rays) return;
    const scans = [];
    for (const [name, mesh] of this.hasRays && this.past.isLive ? this.meshes : []) {
      for (const scan of live.scansOn(name)) scans.push({ ...scan, z: mesh.group.position.z });
    }
    // Those of the selected robot first, since the number of rays is limited.
    scans.sort((one, other) => (other.robot === this.selected) - (one.robot === this.selected));
    this.rays.set(scans, this.selected);
    this.scans = Object.freeze(scans);
  },
  updateGhost() {
    const path = [];
    let heading = 0;
    const isShown = this.past.isLive && this.link && this.link.robot === this.selected;
    for (const point of isShown ? this.link.path : []) {
      const mesh = this.meshes.get(point.floor);
      if (!mesh) continue;
      path.push({ x: point.x, y: point.y, z: mesh.group.position.z });
      heading = point.heading;
    }
    const robot = this.crowd.robot(this.selected);
    const end = path[path.length - 1];
    const isThere = !robot || (end && Math.hypot(end.x - robot.x, end.y - robot.y) < 0.05);
    const key = isThere ? "" : JSON.stringify([path, robot?.joints]);
    if (key === this.ghostKey) return;
    this.ghostKey = key;
    this.crowd.setGhost(isThere ? null : path, heading, robot?.joints);
  },
  // The connection for the path of the selected robot, and for the data pool that is shown.
  connect() {
    const robot = this.source || this.selected;
    if (this.link && this.link.robot === robot && this.link.withPool === this.isPool) return;
    this.link?.close();
    this.link = robot ? new RobotLink(robot, this.isPool, () => this.linkNews()) : null;
  },
  linkNews() {
    if (this.isGone) return;
    const floor = this.isPool ? this.link?.floor?.name : "";
    if (this.isPool && floor && floor !== this.poolFloor) {
      this.poolFloor = floor;
      this.isNew = true;
      this.current = floor;
      this.want();
      this.loadPlans();
    }
    this.say();
    this.update();
  },
};

// A robot in a cabin that travels has the height of the cabin.
function heightOf(body, plan, floor) {
  for (const state of Object.values(floor.elevators)) if (state.riders.includes(body.name)) return state.height;
  return plan.elevation;
}
