// Texts that users gave, for places with little room.

// The first characters of a text, with an ellipsis if there are more than `length`.
export function shortened(text, length) {
  const letters = [...text];
  return letters.length > length ? `${letters.slice(0, length - 1).join("")}\u2026` : text;
}
