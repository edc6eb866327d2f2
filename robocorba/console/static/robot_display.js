// How what a robot's touch panel shows looks: colour and sign of each of the paper's states, a shape beside the colour.
export const DISPLAYS = {
  "": ["#3b4650", "\u2013"], // not known: of the past, or of a robot without an agent
  working: ["#0b5d3b", "\u25b6"],
  waiting: ["#174a7c", "\u2016"],
  exceptional: ["#9b0d4c", "\u26a0"],
};

// The page of a robot's touch panel.
export function panelAddress(robot) {
  return `/panel/${encodeURIComponent(robot)}`;
}

// A display in a line of text.
export function displayText({ kind, text }) {
  return `${DISPLAYS[kind][1]} ${text}`;
}
