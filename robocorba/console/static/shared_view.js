// What a user looks at, kept while they go from page to page; each browser tab has its own.
const KEY = "robocorba-view";

// The floor and the robot that were chosen last ("" for none), and the moment of the past that is shown: {at, recording}
// with `at` in s since 1970 and `recording` "" for the running system; null for the present.
export const sharedView = { floor: "", robot: "", past: null, ...stored() };

// Keep some of it, like rememberView({ floor: "L2" }).
export function rememberView(change) {
  Object.assign(sharedView, change);
  try {
    sessionStorage.setItem(KEY, JSON.stringify(sharedView));
  } catch {
    // the browser keeps nothing: each page begins anew
  }
}

function stored() {
  try {
    return JSON.parse(sessionStorage.getItem(KEY)) ?? {};
  } catch {
    return {};
  }
}
