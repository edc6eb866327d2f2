// Texts that users gave, for places with little room; and times in words.

// The first characters of a text, with an ellipsis if there are more than `length`.
export function shortened(text, length) {
  const letters = [...text];
  return letters.length > length ? `${letters.slice(0, length - 1).join("")}\u2026` : text;
}

// The lines of a text, broken between words, that are at most `width` pixels wide in a canvas's context.
export function wrapped(context, text, width) {
  const lines = [""];
  for (const word of shortened(text, 240).split(/\s+/)) {
    const longer = `${lines[lines.length - 1]} ${word}`.trim();
    if (context.measureText(longer).width > width && lines[lines.length - 1]) lines.push(word);
    else lines[lines.length - 1] = longer;
  }
  return lines.map((each) => shortened(each, 60));
}

// Hours and minutes of a time [s since 1970]; of another day with the day.
export function whenText(at, now = new Date()) {
  const date = new Date(at * 1000);
  const clock = date.toLocaleTimeString(undefined, { hour: "2-digit", minute: "2-digit", hourCycle: "h23" });
  if (date.toDateString() === now.toDateString()) return clock;
  return `${date.toLocaleDateString(undefined, { day: "numeric", month: "short" })} ${clock}`;
}

export function durationText(seconds) {
  if (seconds < 100) return `${Math.max(seconds, 0).toFixed(0)} s`;
  const minutes = Math.floor(seconds / 60);
  return minutes < 100 ? `${minutes} min ${Math.floor(seconds % 60)} s`
    : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}
