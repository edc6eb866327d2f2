// Host and port of a computer in a form; what was used last is remembered for each purpose.
import { keep, kept } from "/static/browser_store.js";

const STORED = "robocorba-addresses";

// What was used last for a purpose: {host, port}, texts.
export function lastAddress(purpose) {
  return { host: "", port: "", ...kept(STORED, "localStorage")?.[purpose] };
}

export function rememberAddress(purpose, { host, port }) {
  keep(STORED, { ...kept(STORED, "localStorage"), [purpose]: { host, port } }, "localStorage");
}

export function isAddress({ host, port }) {
  return Boolean(host.trim()) && /^\d{1,5}$/.test(String(port).trim());
}

export const AddressFields = {
  // address: {host, port}, which is changed; what: whose they are.
  props: { address: Object, what: String },
  template: `
    <label>{{ what }}: host
      <input v-model="address.host" :aria-label="'Host of ' + what" autocomplete="off" spellcheck="false"></label>
    <label>port
      <input v-model="address.port" :aria-label="'Port of ' + what" inputmode="numeric" size="6"></label>`,
};
