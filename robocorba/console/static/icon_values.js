// The values that a new icon begins with: here, left, close, 2 times.
import { fourDigits } from "/static/program_model.js";

const VALUES = {
  mbase_by: { ahead: 0.5 }, mhand_posture: { hand: "left", posture: "ready" }, mhand_pose: { hand: "left" },
  mhand_offset: { hand: "left", dz: 0.05 }, mhand_joints: { hand: "left" }, gripper: { hand: "left", action: "close" },
  wait: { seconds: 1 }, wait_until: { seconds: 10 }, confirm: { question: "go on?", seconds: 60 }, repeat: { times: 2 },
};

// at: the pose of the program's robot, if it is known.
export function firstValues(icon, at) {
  const values = { ...VALUES[icon] };
  if (!at || !["mbase_path", "mbase_to"].includes(icon)) return values;
  const [x, y] = [at.x, at.y].map(fourDigits);
  return icon === "mbase_path" ? { floor: at.floor, x, y } : { x, y };
}
