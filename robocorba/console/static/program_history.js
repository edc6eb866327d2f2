// The program of the program page with its undo history and selection, kept while the user goes from page to page; each
// browser tab has its own.
import { keep, kept } from "/static/browser_store.js";
import { usedIds } from "/static/program_model.js";

const KEY = "robocorba-program-history";
// The length of all kept states together [characters]; a browser keeps some 5 million for a tab.
const MAX_LENGTH = 1_500_000;

// Keep a ProgramModel and which icon is selected (null for none).
export function keepHistory(model, schema, selectedId) {
  const now = model.state(), half = (MAX_LENGTH - now.length) / 2;
  const history = {
    schema: names(schema), now, done: newest(model.done, half), undone: newest(model.undone, half), selectedId,
    ids: usedIds(),
  };
  keep(KEY, now.length > MAX_LENGTH ? null : history);
}

// Put what was kept into a model. Returns which icon was selected, null for none; undefined if nothing was kept.
export function restoreHistory(model, schema) {
  try {
    const history = kept(KEY);
    if (history?.schema !== names(schema)) return undefined; // nothing was kept, or with other icons
    Object.assign(model, JSON.parse(history.now), { done: history.done, undone: history.undone });
    usedIds(history.ids);
    return model.find(history.selectedId) ? history.selectedId : null;
  } catch {
    return undefined;
  }
}

// The last states that have room.
function newest(states, length) {
  let from = states.length;
  for (let left = length; from > 0 && states[from - 1].length <= left; from--) left -= states[from - 1].length;
  return states.slice(from);
}

function names(schema) {
  return [...schema.icons.keys(), ...schema.conditions.keys()].join();
}
