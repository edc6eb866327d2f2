// Texts that users gave, for places with little room.

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
