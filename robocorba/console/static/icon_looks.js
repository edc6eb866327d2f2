// How icons look: a picture, a title and a group of the palette for each, and what one does in a few words.

const LOOKS = {
  mbase_path: ["route", "Drive to a place"],
  mbase_to: ["near_me", "Drive straight to"],
  mbase_by: ["open_with", "Drive by"],
  mbase_velocity: ["speed", "Drive at a speed"],
  mhand_posture: ["accessibility_new", "Arm posture"],
  mhand_pose: ["back_hand", "Hand to a pose"],
  mhand_offset: ["swipe", "Move the hand by"],
  mhand_joints: ["tune", "Arm joints"],
  lumbar: ["airline_seat_recline_normal", "Bend the body"],
  gripper: ["pinch", "Gripper"],
  wait: ["schedule", "Wait"],
  wait_until: ["hourglass_top", "Wait until"],
  confirm: ["contact_support", "Ask a person"],
  stop_if_closer: ["sensors", "Stop if closer"],
  repeat: ["repeat", "Repeat"],
  branch: ["call_split", "If, otherwise"],
  say: ["campaign", "Say an event"],
  move_table: ["table_restaurant", "Carry a table"],
  hand_over: ["handshake", "Hand over"],
};
const GROUPS = [
  ["Base", ["mbase_path", "mbase_to", "mbase_by", "mbase_velocity"]],
  ["Arms and body", ["mhand_posture", "mhand_pose", "mhand_offset", "mhand_joints", "lumbar", "gripper"]],
  ["Sensors, order", ["wait", "wait_until", "confirm", "stop_if_closer", "repeat", "branch"]],
  ["Other robots", ["say", "move_table", "hand_over"]],
];

// Lists of icons inside of an icon, as a message names them.
const INSIDE = { icons: "inside" };

export function pictureOf(icon) {
  return LOOKS[icon]?.[0] ?? "extension";
}

export function titleOf(icon) {
  return LOOKS[icon]?.[1] ?? String(icon);
}

// A message of the robot or the checker in the page's words: icons[4].then[0] is "icon 5, then 1", icons[4].icons[0] is
// "icon 5, inside 1", and kinds of icons have their titles.
export function plainWords(text) {
  const paths = text.replace(/\bicons\[\d+\](?:\.\w+\[\d+\])*/g, (path) => path
    .replace(/^icons\[(\d+)\]/, (_, index) => `icon ${Number(index) + 1}`)
    .replace(/\.(\w+)\[(\d+)\]/g, (_, list, index) => `, ${INSIDE[list] ?? list} ${Number(index) + 1}`));
  return paths.replace(/\b[a-z]+_[a-z_]+\b/g, (word) => (word in LOOKS ? `\u201c${titleOf(word)}\u201d` : word));
}

// The palette: [title, icons] of each group. Icons that only the schema knows come last.
export function groupsOf(schema) {
  const known = new Set(GROUPS.flatMap(([, icons]) => icons));
  const others = [...schema.icons.keys()].filter((icon) => !known.has(icon));
  const groups = GROUPS.map(([title, icons]) => [title, icons.filter((icon) => schema.icons.has(icon))]);
  return [...groups, ["More", others]].filter(([, icons]) => icons.length);
}

// ---- what an icon does ----

const number = (value) => (typeof value === "number" ? Number(value.toFixed(3)) : "?");
const degrees = (value) => (typeof value === "number" ? `${Math.round((value * 180) / Math.PI)}\u00b0` : "?");
const point = (to) => `${to?.floor ?? "?"} ${number(to?.x)}, ${number(to?.y)}`;
const hand = (v) => (v.hand === "both" ? "both hands" : `${v.hand ?? "?"} hand`);

const SUMMARIES = {
  mbase_path: (v) => point(v),
  mbase_to: (v) => `${number(v.x)}, ${number(v.y)}`,
  mbase_by: (v) => `${number(v.ahead ?? 0)} m ahead, ${number(v.left ?? 0)} m left, ${degrees(v.turn ?? 0)}`,
  mbase_velocity: (v) =>
    `${number(v.ahead)} m/s ahead, ${number(v.left)} m/s left, ${degrees(v.turn)}/s for ${number(v.seconds)} s`,
  mhand_posture: (v) => `${hand(v)}: ${v.posture ?? "?"}`,
  mhand_pose: (v) => `${hand(v)} to ${number(v.x)}, ${number(v.y)}, ${number(v.z)}`,
  mhand_offset: (v) => `${hand(v)} by ${number(v.dx ?? 0)}, ${number(v.dy ?? 0)}, ${number(v.dz ?? 0)}`,
  mhand_joints: (v) => `${hand(v)}: ${(v.joints ?? []).map(degrees).join(" ") || "?"}`,
  lumbar: (v) => `${degrees(v.lower)}, ${degrees(v.upper)}`,
  gripper: (v) => `${v.action ?? "?"}, ${hand(v)}${v.object ? `: ${v.object}` : ""}`,
  wait: (v) => `${number(v.seconds)} s`,
  wait_until: (v) => `${conditionText(v.condition)}, at most ${number(v.seconds)} s`,
  confirm: (v) => `${v.question ?? "?"}, at most ${number(v.seconds)} s`,
  stop_if_closer: (v) => `${v.sensor ?? "?"} than ${number(v.distance)} m`,
  repeat: (v) => `${v.times ?? "?"} times`,
  branch: (v) => conditionText(v.condition),
  say: (v) => v.type ?? "?",
  move_table: (v) => `${v.table ?? "?"} to ${point(v.to)}`,
  hand_over: (v) => `${v.object ?? "?"} to ${v.taker ?? "?"}`,
};

const CONDITIONS = {
  closer_than: (c) => `${c.sensor ?? "?"} sees something closer than ${number(c.distance)} m`,
  farther_than: (c) => `${c.sensor ?? "?"} sees nothing within ${number(c.distance)} m`,
  holding: (c) => `${c.hand === "both" ? "both hands hold" : `${c.hand ?? "?"} hand holds`} something`,
  event: (c) => `event ${c.type ?? "*"} from ${c.source ?? "*"}`,
  result: (c) => `last icon: ${String(c.result ?? "?").replace("_", " ")}`,
};

function conditionText(condition) {
  return CONDITIONS[condition?.when]?.(condition) ?? "?";
}

export function summary(node) {
  return String(SUMMARIES[node.icon]?.(node.values) ?? "");
}
