// Floors and plans of the past: of the last half hour, or of an open recording.
import { Floor, readFrame } from "/static/floor_state.js";

const LIMIT_MS = 10000;
const AGAIN_MS = 2000;
const MOST_PLANS = 60;
// One looks back so long before an event, and a moment is told with the event before it [s].
export const BEFORE_S = 3;

// Let a page with a time bar look back to just before an event, at its floor and robot.
export function lookBack(page, { floor, robot, at }) {
  if (page.floors.includes(floor) && !page.isStacked) page.show(floor);
  if (robot) page.selected = robot;
  page.$refs.time.recording = "";
  page.$nextTick(() => page.$refs.time.seek(at - BEFORE_S));
}

export function clockText(at) {
  return new Date(at * 1000).toLocaleTimeString(undefined, { hourCycle: "h23" });
}

// Why a request has failed, in words for the user.
export function failure(error) {
  return error instanceof TypeError || error.name === "TimeoutError" ? "the console does not answer" : error.message;
}

// Floors by name as they were at a time [s since 1970], and why some are missing: {floors, problem}. recording: the key
// of an open one, or "" for the running system.
export async function pastFloors(names, at, recording) {
  const results = await Promise.allSettled(names.map((name) => pastFloor(name, at, recording)));
  const found = results.filter(({ status }) => status === "fulfilled").map(({ value }) => value);
  const failed = results.find(({ status }) => status === "rejected");
  return {
    floors: new Map(found.map((floor) => [floor.name, floor])), problem: failed ? failure(failed.reason) : "",
  };
}

async function pastFloor(name, at, recording) {
  const buffer = await (await fetched("/past", { floor: name, at, recording })).arrayBuffer();
  const { header, offset } = readFrame(buffer);
  const floor = new Floor(name);
  floor.apply(header, buffer, offset);
  return floor;
}

async function fetched(address, query) {
  const answer = await fetch(`${address}?${new URLSearchParams(query)}`, { signal: AbortSignal.timeout(LIMIT_MS) });
  if (!answer.ok) throw new Error((await answer.json()).error);
  return answer;
}

const plans = new Map();

// The plan of a floor in a recording, or undefined until it is loaded; then, or to ask again, `news` is called.
export function recordedPlan(recording, floor, news) {
  const key = `${recording}\n${floor}`;
  if (!plans.has(key)) {
    if (plans.size >= MOST_PLANS) plans.clear();
    plans.set(key, undefined);
    fetched("/plan", { floor, recording }).then((answer) => answer.json()).then((plan) => {
      plans.set(key, plan);
      news();
    }).catch(() => setTimeout(() => {
      plans.delete(key);
      news();
    }, AGAIN_MS));
  }
  return plans.get(key);
}
