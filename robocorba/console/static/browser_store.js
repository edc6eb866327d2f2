// What the browser keeps for the console, as JSON: "sessionStorage" for one tab, "localStorage" for all. It may keep
// nothing, as when users forbid it.

// What is kept under a key; null if nothing is.
export function kept(key, store = "sessionStorage") {
  try {
    return JSON.parse(window[store].getItem(key));
  } catch {
    return null;
  }
}

// Keep a value, or nothing for null. Returns whether the browser does.
export function keep(key, value, store = "sessionStorage") {
  try {
    if (value === null) window[store].removeItem(key);
    else window[store].setItem(key, JSON.stringify(value));
    return true;
  } catch {
    return false;
  }
}
