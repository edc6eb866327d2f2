// Missions in words for operators; their names are for programs.
import { titleOf } from "/static/icon_looks.js";
import { whenText } from "/static/texts.js";

const VERBS = { move_table: "Carry", hand_over: "Hand over" };

// Such as "Carry cafe-table-2, 09:40".
export function missionTitle({ kind, about, begun }) {
  return `${VERBS[kind] ?? titleOf(kind)} ${about}, ${whenText(begun)}`;
}

// Who would come to a mission, from the answer of mission_party.
export function partyText({ robots: [leader, ...helpers], aside }) {
  if (!leader) return "it is at its goal already";
  const parts = [`${leader} leads`];
  if (helpers.length) parts.push(`${helpers.join(" and ")} ${helpers.length > 1 ? "help" : "helps"}`);
  if (aside.length) parts.push(`${aside.join(" and ")} ${aside.length > 1 ? "step" : "steps"} aside`);
  return parts.join(", ");
}
