// What has happened in the system, with the missions that began and ended, for the time bar and the list of events.
import { call, live } from "/static/live.js";
import { missionTitle } from "/static/mission_words.js";

// Events are kept for this time [s], and up to this number.
const KEPT_S = 1800;
const MOST = 2000;

export class HappeningFeed {
  // changed(events): called with all events, the oldest first. Missions are among them for a page that wants missions.
  constructor(changed) {
    this.changed = changed;
    this.happenings = [];
    this.missions = [];
    this.last = 0;
    this.unlisten = live.listen((kind) => this.news(kind));
    this.news("missions");
    this.news("state");
  }

  news(kind) {
    if (kind === "missions") {
      this.missions = missionEvents(live.missions.values(), (live.state?.past[1] ?? 0) - KEPT_S);
      this.say();
    } else if (kind === "state" && live.state) {
      const { happenings } = live.state;
      if (happenings < this.last) this.last = 0; // another process of the console counts from 1 again
      if (happenings > this.last) this.ask();
    }
  }

  async ask() {
    if (this.isAsking) return;
    this.isAsking = true;
    try {
      const news = await call("happenings", { after: this.last }, 10000);
      this.last = news.at(-1)?.number ?? this.last;
      // A state that is older than the last answer looks like that of another process: some come twice.
      const known = new Set(this.happenings.map(({ at, number }) => `${at} ${number}`));
      const fresh = news.filter(({ at, number }) => !known.has(`${at} ${number}`));
      this.happenings = [...this.happenings, ...fresh].slice(-MOST);
      this.say();
    } catch {
      // the connection is lost, which the header says; asked again with the next news
    } finally {
      this.isAsking = false;
    }
  }

  say() {
    if (this.isClosed) return;
    const known = [...live.missions.values()];
    const isOfMission = ({ kind }) => kind === "mission" || kind === "program";
    const happenings = this.happenings.map((each) => (isOfMission(each) ? titled(each, known) : each));
    this.changed([...happenings, ...this.missions].sort((a, b) => a.at - b.at));
  }

  close() {
    this.isClosed = true;
    this.unlisten();
  }
}

// The begin and the end of each mission since a time, as happenings.
function missionEvents(missions, since) {
  const event = (mission, what, at, text) => ({
    number: `${what} ${mission.name}`, at, kind: "mission", robot: mission.leader, floor: "", mission: mission.name,
    text: `${missionTitle(mission)} ${text}`,
  });
  const end = ({ result, reason }) => `has ended, ${result}${reason ? `: ${reason}` : ""}`;
  return [...missions].flatMap((mission) => [
    event(mission, "begin", mission.begun, "has begun"),
    mission.ended && event(mission, "end", mission.ended, end(mission)),
  ]).filter((each) => each && each.at >= since);
}

// A happening of a mission with the mission's title instead of its name, and of the number of its attempt.
export function titled(happening, missions) {
  const mission = missions.find(({ name }) => happening.text.includes(`mission ${name}`)
    || happening.text.includes(`mission \u2068${name}`));
  if (!mission) return happening;
  const name = mission.name.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
  const named = new RegExp(`\u2068?mission \u2068?${name}(\\.\\d+)?\u2069?`);
  return { ...happening, mission: mission.name, text: happening.text.replace(named, () => missionTitle(mission)) };
}

// The happenings of a kind ("" for all) that have all words.
export function wantedOf(happenings, kind, words) {
  const wanted = words.toLowerCase().split(/\s+/).filter(Boolean);
  const has = ({ text, robot }) => wanted.every((word) => `${text} ${robot}`.toLowerCase().includes(word));
  return happenings.filter((each) => (!kind || each.kind === kind) && has(each));
}

// Happenings in their order, those of a mission as one: the first one, with the others in `inner`.
export function foldedByMission(happenings) {
  const heads = new Map();
  return happenings.flatMap((each) => {
    const head = heads.get(each.mission);
    if (head) {
      head.inner.push(each);
      return [];
    }
    const row = { ...each, inner: [] };
    if (each.mission) heads.set(each.mission, row);
    return [row];
  });
}
