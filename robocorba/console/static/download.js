// Files that the page makes.

// Time until the browser has taken the content [ms].
const TAKEN_MS = 10_000;

// Let the browser save a file. content: text or bytes. What no file name can have becomes "_".
export function download(name, content, type = "application/octet-stream") {
  const address = URL.createObjectURL(new Blob([content], { type }));
  const link = document.createElement("a");
  Object.assign(link, { href: address, download: name.replace(/[^\p{L}\p{N}.-]+/gu, "_").slice(-100) });
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), TAKEN_MS);
}
