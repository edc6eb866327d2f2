// What a user looks at, kept while they go from page to page; each browser tab has its own. It is also in the address of
// the page, so that a link shows the same to others.
import { keep, kept } from "/static/browser_store.js";

const KEY = "robocorba-view";
// The address follows after this time without changes [ms]: browsers refuse more than some 3 a second.
const ADDRESS_MS = 400;

// The floor and the robot that were chosen last ("" for none), and the moment of the past that is shown: {at, recording}
// with `at` in s since 1970 and `recording` "" for the running system; null for the present.
export const sharedView = { floor: "", robot: "", past: null, ...kept(KEY), ...viewOf(location.search) };

// Names in the address that are to change, and when.
const changes = {};
let timer;

// Keep some of it, like rememberView({ floor: "L2" }). shown: what the address is to say of it, "" for nothing.
export function rememberView(change, shown = inAddress(change)) {
  Object.assign(sharedView, change);
  keep(KEY, sharedView);
  Object.assign(changes, shown);
  clearTimeout(timer);
  timer = setTimeout(noteAddress, ADDRESS_MS);
}

function noteAddress() {
  const query = new URLSearchParams(location.search);
  for (const [name, value] of Object.entries(changes)) {
    if (value) query.set(name, value);
    else query.delete(name);
  }
  history.replaceState(history.state, "", `${location.pathname}${query.size ? `?${query}` : ""}`);
}

// What an address says: only what it has.
export function viewOf(search) {
  const query = new URLSearchParams(search), view = {};
  for (const name of ["floor", "robot"]) if (query.get(name)) view[name] = query.get(name);
  const at = Number(query.get("at"));
  if (at > 0) view.past = { at, recording: query.get("recording") ?? "" };
  return view;
}

// The inverse for a part of the view; "" for what is to go from the address.
export function inAddress({ past, ...names }) {
  if (past === undefined) return names;
  return { ...names, at: past ? past.at.toFixed(1) : "", recording: past?.recording ?? "" };
}
