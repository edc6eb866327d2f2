// Rows of the monitor's table from what the servers report. Robots that were seen once stay, with the age of their
// news.
import { distanceTo, placed } from "/static/segments.js";

// A robot without news for this time is shown as lost [s].
export const LOST_S = 3;
// How long a collision is shown [s].
const COLLISION_S = 4;
// Gap up to which two bodies, or a body and a wall, are regarded as touching [m].
const TOUCH_M = 0.03;

// {name, floor, at, isLost, isHere, age, condition, display, program, agent, client, problem}, sorted by name.
// isHere: the simulation has it. age: of its agent's last news, or for one without agent of its last call [s]; null:
// none yet.
export function robotRows(state, waitS) {
  const clients = new Map((state.server.state?.clients ?? []).map((client) => [client.name, client]));
  const gone = state.gone ?? {};
  const names = new Set([...Object.keys(state.robots), ...clients.keys(), ...Object.keys(gone)]);
  const isServerLost = Boolean(state.server.problem);
  return [...names].sort(byName).map((name) => {
    const entry = state.robots[name];
    const agent = entry?.state ?? null;
    const isHere = clients.has(name) && !isServerLost;
    const client = clients.get(name) ?? gone[name]?.client ?? null;
    const clientAge = clients.has(name) ? (state.server.age ?? 0) + waitS : (gone[name]?.age ?? 0) + waitS;
    const age = entry?.age == null ? (client ? clientAge : null) : entry.age + waitS;
    const isLost = age === null || age > LOST_S || (!isHere && (!agent || agent.adaptor === "simulated"));
    const at = client?.at ?? agent?.at ?? null;
    const absence = absenceOf(entry, agent, isHere);
    return {
      name, agent, client, at, isHere, isLost, age,
      floor: at?.floor ?? "",
      // Since when the simulation does not have it any more [s].
      goneAge: isHere || !gone[name] ? null : gone[name].age + waitS,
      isSilent: Boolean(entry) && (entry.age == null || entry.age + waitS > LOST_S),
      condition: absence || (agent?.condition.toLowerCase() ?? ""),
      // What its touch panel shows; of a robot whose agent is not there, or not known yet, why.
      display: absence || !agent ? { kind: "", text: absence, seconds: 0 } : agent.display,
      program: agent?.program.name ?? "",
      path: entry?.state?.path ?? null,
      mission: entry?.state?.mission ?? "",
      problem: entry?.problem ?? "",
    };
  });
}

function byName(a, b) {
  return a.localeCompare(b, undefined, { numeric: true });
}

// Why nothing is known of a robot's agent now; empty if it is there.
function absenceOf(entry, agent, isHere) {
  if (!entry) return isHere ? "no agent" : "left";
  if (!isHere && !entry.bound) return "left";
  if (agent && !isHere && agent.adaptor === "simulated") return "logged off";
  return entry.problem ? "no answer" : "";
}

export function ageText(age) {
  if (age === null) return "none";
  if (age < 10) return `${age.toFixed(1)} s`;
  if (age < 120) return `${age.toFixed(0)} s`;
  return age < 7200 ? `${(age / 60).toFixed(0)} min` : `${(age / 3600).toFixed(0)} h`;
}

export function degrees(angle) {
  return `${Math.round((angle * 180) / Math.PI) || 0}\u00b0`;
}

// Finds which robots touch something when the server's count of collisions rises.
export class Collisions {
  constructor() {
    this.count = null;
    this.until = new Map();
  }

  // Names of the robots that are to be shown as colliding.
  update(count, floor, plan) {
    const now = performance.now();
    if (this.count !== null && count > this.count) {
      for (const name of touching(floor, plan)) this.until.set(name, now + COLLISION_S * 1000);
    }
    this.count = count;
    for (const [name, until] of this.until) if (until < now) this.until.delete(name);
  }

  has(name) {
    return this.until.has(name);
  }
}

function touching(floor, plan) {
  const bodies = [...(floor?.bodies.values() ?? [])];
  const robots = bodies.filter((body) => body.kind !== "object");
  const walls = (plan?.walls ?? []).flatMap((wall) => wall.pieces);
  return robots.filter((robot) => bodies.some((body) => body !== robot && touches(robot, body))
    || walls.some((piece) => distanceTo(middle(robot), piece[0], piece[piece.length - 1]) < robot.radius + TOUCH_M))
    .map((robot) => robot.name);
}

const middle = ({ x, y }) => [x, y];

function touches(robot, body) {
  const reach = robot.radius + TOUCH_M;
  if (body.kind !== "object") return Math.hypot(robot.x - body.x, robot.y - body.y) < reach + body.radius;
  const corners = placed(body.outline, { at: middle(body), heading: body.heading });
  const next = (index) => corners[(index + 1) % corners.length];
  return corners.some((corner, index) => distanceTo(middle(robot), corner, next(index)) < reach);
}
